// SPDX-License-Identifier: Apache-2.0
#include "gs_app/jobs/experiment/experiment_progress.h"

#include <spdlog/fmt/fmt.h>
#include <unistd.h>

#include <csignal>

#include "gs_app/experiment/tables/experiment_tables.h"
#include "gs_app/report/report_experiment.h"
#include "gs_app/run/text.h"
#include "gs_core/error.h"
#include "gs_core/system/log.h"

namespace gs {
namespace {

bool is_stopped(const ProcessEnd& end) {
  return end.exit_code == int(ExitCode::interrupted) || end.signal == SIGTERM;
}

}  // namespace

std::string describe(const ProcessEnd& end, const std::string& error) {
  if (!error.empty()) return error;
  return end.signal ? fmt::format("killed by signal {}", end.signal)
                    : fmt::format("exit code {}", end.exit_code);
}

std::size_t write_outcome(const Experiment& experiment, const std::vector<ExperimentRun>& runs,
                          const std::vector<std::size_t>& failed) {
  const std::size_t finished = write_tables(experiment, runs, failed);
  keep_experiment_report(experiment.output);
  return finished;
}

ExperimentProgress::ExperimentProgress(const Experiment& experiment,
                                       const std::vector<ExperimentRun>& runs, std::size_t todo,
                                       bool is_shown, double status_every)
    : experiment_(experiment), runs_(runs), todo_(todo), is_terminal_(::isatty(STDERR_FILENO) == 1),
      bar_(std::int64_t(runs.size()), is_terminal_ && is_shown),
      status_(is_terminal_ ? 0 : status_every) {}

void ExperimentProgress::started(const ExperimentRun& run, const RunSlot& slot) {
  bar_.clear();
  status_.started(run);
  log_info("{} starts{}; log: {}", run.name(), slot.device.empty() ? "" : " on " + slot.device,
           run.log().string());
}

void ExperimentProgress::ended(const ExperimentRun& run, const ProcessEnd& end, double seconds,
                               const std::string& error) {
  bar_.clear();
  status_.ended(run);
  if (error.empty() && is_stopped(end)) {
    stopped_.push_back({&run, describe(end, error)});
    return log_info("{} was stopped", run.name());
  }
  ++ended_;
  const bool is_good = error.empty() && end.good() && is_finished(run);
  if (!is_good) failures_.push_back({&run, describe(end, error)});
  const std::string outcome =
      is_good ? summary_of(run)
              : fmt::format("FAILED ({}); log: {}", failures_.back().why, run.log().string());
  log_info("[{}/{}] {}: {} | {}; {} left", runs_.size() - todo_ + ended_, runs_.size(), run.name(),
           outcome, clock_text(seconds), clock_text(seconds_left()));
  try {
    write();
  } catch (const Error& failure) {  // it costs no run; the last tables are those that count
    log_warning("the tables are not up to date: {}", failure.what());
  }
}

void ExperimentProgress::waiting(std::size_t running) {
  const auto done = std::int64_t(runs_.size() - todo_ + ended_);
  if (bar_.due(done))
    bar_.draw(done, fmt::format("{} running, {} failed", running, failures_.size()), "run");
  status_.waiting(fmt::format("{} of {} runs done; ", done, runs_.size()));
}

std::size_t ExperimentProgress::write() const {
  std::vector<std::size_t> failed;
  for (const FailedRun& failure : failures_) failed.push_back(failure.run->index);
  return write_outcome(experiment_, runs_, failed);
}

std::vector<FailedRun> ExperimentProgress::failures() const {
  std::vector<FailedRun> all = failures_;
  all.insert(all.end(), stopped_.begin(), stopped_.end());
  return all;
}

// Assumes that the other runs take as long as those that have ended, with as many at a time.
double ExperimentProgress::seconds_left() const {
  const double elapsed = std::chrono::duration<double>(Clock::now() - start_).count();
  return elapsed / double(ended_) * double(todo_ - ended_);
}

}  // namespace gs
