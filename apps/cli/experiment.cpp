// SPDX-License-Identifier: Apache-2.0
// gemsplat experiment: trains scenes x configs x seeds of a file, each run in its own process, and
// writes tables.
#include <spdlog/fmt/fmt.h>
#include <unistd.h>

#include <CLI/CLI.hpp>
#include <algorithm>
#include <chrono>
#include <csignal>
#include <iostream>
#include <memory>

#include "apps/cli/verbs.h"
#include "gs_app/experiment/experiment_pool.h"
#include "gs_app/experiment/experiment_status.h"
#include "gs_app/experiment/slurm.h"
#include "gs_app/experiment/tables/experiment_tables.h"
#include "gs_app/report/report_experiment.h"
#include "gs_app/run/progress_bar.h"
#include "gs_app/run/text.h"
#include "gs_core/error.h"
#include "gs_core/system/files/output_lock.h"
#include "gs_core/system/log.h"
#include "gs_core/threads/parallel.h"

namespace gs {
namespace {

struct ExperimentCommand {
  std::string file;
  std::vector<std::string> devices;
  int jobs = 1;
  int gpus_per_run = 0;  // 0: as the runs' settings say
  long only = -1;
  double status_every = 60;  // seconds
  bool gather = false, slurm = false, dry_run = false, quiet = false;
};

using Runs = std::vector<const ExperimentRun*>;

Runs unfinished(const std::vector<ExperimentRun>& runs) {
  Runs result;
  for (const ExperimentRun& run : runs)
    if (!is_finished(run)) result.push_back(&run);
  return result;
}

std::vector<RunSlot> slots_of(const ExperimentCommand& command) {
  return slots_on(command.devices, command.gpus_per_run, command.jobs);
}

std::string describe(const ProcessEnd& end, const std::string& error) {
  if (!error.empty()) return error;
  return end.signal ? fmt::format("killed by signal {}", end.signal)
                    : fmt::format("exit code {}", end.exit_code);
}

bool is_stopped(const ProcessEnd& end) {
  return end.exit_code == int(ExitCode::interrupted) || end.signal == SIGTERM;
}

// Writes the tables and the report. Returns the number of finished runs.
std::size_t write_outcome(const Experiment& experiment, const std::vector<ExperimentRun>& runs,
                          const std::vector<std::size_t>& failed) {
  const std::size_t finished = write_tables(experiment, runs, failed);
  keep_experiment_report(experiment.output);
  return finished;
}

struct Failure {
  const ExperimentRun* run;
  std::string why;
};

/// Shows the progress of the experiment, as a bar on a terminal and as lines of the log elsewhere,
/// and writes the tables whenever a run has ended.
class Progress {
 public:
  Progress(const Experiment& experiment, const std::vector<ExperimentRun>& runs, std::size_t todo,
           const ExperimentCommand& command)
      : experiment_(experiment), runs_(runs), todo_(todo),
        is_terminal_(::isatty(STDERR_FILENO) == 1),
        bar_(std::int64_t(runs.size()), is_terminal_ && !command.quiet),
        status_(is_terminal_ ? 0 : command.status_every) {}

  void started(const ExperimentRun& run, const RunSlot& slot) {
    bar_.clear();
    status_.started(run);
    log_info("{} starts{}; log: {}", run.name(), slot.device.empty() ? "" : " on " + slot.device,
             run.log().string());
  }

  void ended(const ExperimentRun& run, const ProcessEnd& end, double seconds,
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
    log_info("[{}/{}] {}: {} | {}; {} left", runs_.size() - todo_ + ended_, runs_.size(),
             run.name(), outcome, clock_text(seconds), clock_text(seconds_left()));
    try {
      write();
    } catch (const Error& failure) {  // it costs no run; the last tables are those that count
      log_warning("the tables are not up to date: {}", failure.what());
    }
  }

  void waiting(std::size_t running) {
    const auto done = std::int64_t(runs_.size() - todo_ + ended_);
    if (bar_.due(done))
      bar_.draw(done, fmt::format("{} running, {} failed", running, failures_.size()), "run");
    status_.waiting(fmt::format("{} of {} runs done; ", done, runs_.size()));
  }

  std::size_t write() const {
    std::vector<std::size_t> failed;
    for (const Failure& failure : failures_) failed.push_back(failure.run->index);
    return write_outcome(experiment_, runs_, failed);
  }

  /// Includes runs that were stopped: they count as failed unless the whole experiment was stopped.
  std::vector<Failure> failures() const {
    std::vector<Failure> all = failures_;
    all.insert(all.end(), stopped_.begin(), stopped_.end());
    return all;
  }

 private:
  // Assumes that the other runs take as long as those that have ended, with as many at a time.
  double seconds_left() const {
    const double elapsed = std::chrono::duration<double>(Clock::now() - start_).count();
    return elapsed / double(ended_) * double(todo_ - ended_);
  }

  using Clock = std::chrono::steady_clock;
  const Experiment& experiment_;
  const std::vector<ExperimentRun>& runs_;
  std::size_t todo_, ended_ = 0;
  bool is_terminal_;
  ProgressBar bar_;
  StatusLog status_;
  std::vector<Failure> failures_, stopped_;
  Clock::time_point start_ = Clock::now();
};

bool work(const ExperimentCommand& command, const Runs& runs, Progress& progress) {
  const PoolEvents events = {
      [&](const auto& run, const auto& slot) { progress.started(run, slot); },
      [&](const auto& run, const auto& end, double seconds, const auto& error) {
        progress.ended(run, end, seconds, error);
      },
      [&](std::size_t running) { progress.waiting(running); }};
  return run_pool(runs, slots_of(command), events);
}

[[noreturn]] void throw_stopped(const ExperimentCommand& command) {
  throw Error(
      fmt::format("stopped by a signal; finished runs are kept, and `gemsplat experiment {}` "
                  "goes on with the other runs",
                  command.file),
      ExitCode::interrupted);
}

void throw_failures(const std::vector<Failure>& failures) {
  if (failures.empty()) return;
  for (const Failure& failure : failures)
    log_error("{}: {}; log: {}", failure.run->name(), failure.why, failure.run->log().string());
  throw Error(
      fmt::format("{} of the runs failed; run the command again to repeat them", failures.size()));
}

std::string outcome_text(const Experiment& experiment, std::size_t finished, std::size_t runs) {
  const auto report = experiment.output / "report.html";
  std::string text = fmt::format("{} of {} runs finished\ntables: {}\n", finished, runs,
                                 (experiment.output / "results.md").string());
  if (std::filesystem::exists(report)) text += fmt::format("report: {}\n", report.string());
  return text;
}

void run_all(const ExperimentCommand& command, const Experiment& experiment,
             const std::vector<ExperimentRun>& runs) {
  const OutputLock lock = OutputLock::of_folder(experiment.output);
  const Runs todo = unfinished(runs);
  log_info("{}: {} runs, {} finished already; output: {}", command.file, runs.size(),
           runs.size() - todo.size(), experiment.output.string());
  Progress progress(experiment, runs, todo.size(), command);
  progress.write();
  const bool is_whole = work(command, todo, progress);
  const std::size_t finished = progress.write();
  if (!command.quiet) std::cout << outcome_text(experiment, finished, runs.size());
  if (!is_whole) throw_stopped(command);
  throw_failures(progress.failures());
}

// Trains one run as a task of a job array. Other tasks work on the same output, so the tables are
// written later (--gather).
void run_only(const ExperimentCommand& command, const Experiment& experiment,
              const std::vector<ExperimentRun>& runs) {
  if (std::size_t(command.only) >= runs.size())
    throw UsageError(fmt::format("--only {}: the runs of {} have the numbers 0 to {}", command.only,
                                 command.file, runs.size() - 1));
  const ExperimentRun& run = runs[std::size_t(command.only)];
  const OutputLock lock = OutputLock::of_folder(experiment.output, OutputLock::Kind::shared);
  if (is_finished(run)) return log_info("{} is finished already", run.name());
  std::string why;
  StatusLog status(command.status_every);
  const PoolEvents events = {[&](const auto& started, const auto&) {
                               log_info("{} begins; log: {}", started.name(),
                                        started.log().string());
                               status.started(started);
                             },
                             [&](const auto& ended, const auto& end, double, const auto& error) {
                               status.ended(ended);
                               if (!error.empty() || !end.good() || !is_finished(ended))
                                 why = describe(end, error);
                             },
                             [&](std::size_t) { status.waiting(); }};
  if (!run_pool({&run}, {slots_of(command).front()}, events)) throw_stopped(command);
  if (!why.empty())
    throw Error(fmt::format("{} failed: {}; log: {}", run.name(), why, run.log().string()));
  log_info("{}: {}", run.name(), summary_of(run));
}

void gather(const Experiment& experiment, const std::vector<ExperimentRun>& runs) {
  const std::size_t finished = write_outcome(experiment, runs, {});
  std::cout << outcome_text(experiment, finished, runs.size());
  const Runs missing = unfinished(runs);
  for (const ExperimentRun* run : missing)
    log_error("no results: {} {}; log: {}", run->index, run->name(), run->log().string());
  if (!missing.empty())
    throw Error(
        fmt::format("{} runs have no results; give --only with their number, or run the "
                    "command again",
                    missing.size()));
}

void list(const std::vector<ExperimentRun>& runs) {
  for (const ExperimentRun& run : runs)
    std::cout << fmt::format("{:>4} {:<10} {}\n", run.index,
                             is_finished(run) ? "finished" : "to do", run.name());
}

void experiment(const ExperimentCommand& command) {
  setup_log(command.quiet ? Verbosity::quiet : Verbosity::normal);
  const Experiment experiment = read_experiment(command.file);
  const std::vector<ExperimentRun> runs = runs_of(experiment);
  if (command.gather) {
    gather(experiment, runs);
  } else if (command.slurm) {
    submit(experiment, unfinished(runs), command.gpus_per_run, command.dry_run);
  } else if (command.dry_run) {
    list(runs);
  } else if (command.only >= 0) {
    run_only(command, experiment, runs);
  } else {
    run_all(command, experiment, runs);
  }
}

}  // namespace

void add_experiment(CLI::App& program) {
  CLI::App& verb = *program.add_subcommand(
      "experiment", "Train scenes x configs x seeds of a file and write tables of the results");
  const auto command = std::make_shared<ExperimentCommand>();
  verb.add_option("file", command->file, "the experiment (docs/guide/experiments.md)")
      ->type_name("FILE.toml")
      ->required();
  verb.add_option("--devices", command->devices,
                  "distribute the runs over these devices [train.device of each run]")
      ->type_name("cuda:0,cuda:1,...")
      ->delimiter(',');
  verb.add_option("--jobs", command->jobs, "runs at a time on each device [1]")
      ->type_name("N")
      ->check(CLI::Range(1, 1024));
  verb.add_option("--gpus-per-run", command->gpus_per_run,
                  "GPUs for each run, with consecutive numbers (docs/guide/several_gpus.md)")
      ->type_name("N")
      ->check(CLI::Range(1, kMostBatch));
  auto* only = verb.add_option("--only", command->only,
                               "train this run only, numbered from 0 as in --dry-run")
                   ->type_name("INDEX")
                   ->check(CLI::NonNegativeNumber);
  auto* gathers = verb.add_flag("--gather", command->gather,
                                "write the tables of the finished runs and train nothing");
  auto* slurm = verb.add_flag("--slurm", command->slurm,
                              "submit the unfinished runs to Slurm as a job array");
  verb.add_flag(
      "--dry-run", command->dry_run,
      "list the runs and train nothing; with --slurm, write the script without submitting it");
  verb.add_option("--status-every", command->status_every,
                  "without a terminal, seconds between two lines of progress; 0: none [60]")
      ->type_name("SECONDS")
      ->check(CLI::NonNegativeNumber);
  verb.add_flag("-q,--quiet", command->quiet, "print warnings and errors only");
  gathers->excludes(only)->excludes(slurm);
  slurm->excludes(only);
  verb.callback([command] { experiment(*command); });
}

}  // namespace gs
