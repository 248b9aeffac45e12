// SPDX-License-Identifier: Apache-2.0
// Trains the runs of an experiment, each in a process of its own, several at a time.
#pragma once

#include <functional>
#include <vector>

#include "gs_app/experiment/experiment_run.h"
#include "gs_core/system/processes/subprocess.h"

namespace gs {

/// Callbacks of a pool.
struct PoolEvents {
  std::function<void(const ExperimentRun&, const RunSlot&)> started;
  /// `seconds` since its start. `error` says why a run could not be started; otherwise it is empty.
  std::function<void(const ExperimentRun&, const ProcessEnd&, double seconds,
                     const std::string& error)>
      ended;
  std::function<void(std::size_t running)> waiting;  // called some 50 times a second
};

/// Trains the runs in order, one in each slot at a time. After SIGINT or SIGTERM it ends the
/// running ones and starts no more; after a second signal it kills them. Returns false if a signal
/// came. Only one pool may run at a time.
bool run_pool(const std::vector<const ExperimentRun*>& runs, const std::vector<RunSlot>& slots,
              const PoolEvents& events);

}  // namespace gs
