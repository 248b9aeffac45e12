// SPDX-License-Identifier: Apache-2.0
// The progress of an experiment: a bar on a terminal, lines of the log elsewhere, and tables.
#pragma once

#include <chrono>
#include <string>
#include <vector>

#include "gs_app/experiment/experiment_pool.h"
#include "gs_app/experiment/experiment_status.h"
#include "gs_app/run/progress_bar.h"

namespace gs {

/// How a process ended: "exit code 3", or the error that kept it from starting.
std::string describe(const ProcessEnd& end, const std::string& error);

/// Writes the tables and the report. Returns the number of finished runs.
std::size_t write_outcome(const Experiment& experiment, const std::vector<ExperimentRun>& runs,
                          const std::vector<std::size_t>& failed);

struct FailedRun {
  const ExperimentRun* run;
  std::string why;
};

/// Shows how far it is, and writes the tables whenever a run has ended.
class ExperimentProgress {
 public:
  /// `todo` of the runs are trained. Without a terminal, a line comes every `status_every` seconds.
  ExperimentProgress(const Experiment& experiment, const std::vector<ExperimentRun>& runs,
                     std::size_t todo, bool is_shown, double status_every);

  void started(const ExperimentRun& run, const RunSlot& slot);
  void ended(const ExperimentRun& run, const ProcessEnd& end, double seconds,
             const std::string& error);
  void waiting(std::size_t running);

  /// write_outcome() with the runs that have failed by now.
  std::size_t write() const;
  /// Includes runs that were stopped: they count as failed unless the whole experiment was stopped.
  std::vector<FailedRun> failures() const;

 private:
  double seconds_left() const;

  using Clock = std::chrono::steady_clock;
  const Experiment& experiment_;
  const std::vector<ExperimentRun>& runs_;
  std::size_t todo_, ended_ = 0;
  bool is_terminal_;
  ProgressBar bar_;
  StatusLog status_;
  std::vector<FailedRun> failures_, stopped_;
  Clock::time_point start_ = Clock::now();
};

}  // namespace gs
