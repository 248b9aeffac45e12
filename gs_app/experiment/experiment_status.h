// SPDX-License-Identifier: Apache-2.0
// What an experiment says of its runs while they are trained, where no terminal can show a bar.
#pragma once

#include <chrono>
#include <string>
#include <vector>

#include "gs_app/experiment/experiment_run.h"

namespace gs {

/// "garden/cap/seed1 at step 3,000 of 30,000". The step is that of the newest row in the run's
/// metrics.csv, so it may be up to train.log_every steps old.
std::string status_of(const ExperimentRun& run);

/// Logs every so many seconds how far the runs at work are. The runs outlive it.
class StatusLog {
 public:
  /// 0 seconds: logs nothing.
  explicit StatusLog(double seconds_between) : seconds_between_(seconds_between) {}

  void started(const ExperimentRun& run);
  void ended(const ExperimentRun& run);
  /// Call it often. `before` is the start of the line, such as "2 of 8 runs done; ".
  void waiting(const std::string& before = "");

 private:
  using Clock = std::chrono::steady_clock;

  double seconds_between_;
  std::vector<const ExperimentRun*> running_;
  Clock::time_point last_line_ = Clock::now();  // that of a start or an end, too
};

}  // namespace gs
