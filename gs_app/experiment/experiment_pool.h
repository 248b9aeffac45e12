// SPDX-License-Identifier: Apache-2.0
// Runs of an experiment as processes, so many at a time.
#pragma once

#include <functional>
#include <vector>

#include "gs_app/experiment/experiment_run.h"
#include "gs_core/io/subprocess.h"

namespace gs {

/// What happens in a pool.
struct PoolEvents {
  std::function<void(const ExperimentRun&, const RunSlot&)> started;
  /// `seconds` since the start. Where the run could not even be started, `error` says why.
  std::function<void(const ExperimentRun&, const ProcessEnd&, double seconds,
                     const std::string& error)>
      ended;
  std::function<void(std::size_t running)> waiting;  // some times a second
};

/// Does the runs in order, one in each slot at a time, and calls the events. SIGINT and SIGTERM end the runs at hand and
/// start no more, a second signal kills them. Returns whether it was not stopped so. One at a time.
bool run_pool(const std::vector<const ExperimentRun*>& runs, const std::vector<RunSlot>& slots,
              const PoolEvents& events);

}  // namespace gs
