// SPDX-License-Identifier: Apache-2.0
// gemsplat experiment: trains scenes x configs x seeds of a file, each run in its own process, and
// writes tables.
#include <spdlog/fmt/fmt.h>

#include "gs_app/experiment/slurm.h"
#include "gs_app/experiment/tables/experiment_tables.h"
#include "gs_app/jobs/experiment/experiment_progress.h"
#include "gs_app/jobs/verbs.h"
#include "gs_app/run/text.h"
#include "gs_core/math/constants.h"
#include "gs_core/system/files/output_lock.h"

namespace gs {
namespace {

constexpr int kMostJobs = 1024;

struct ExperimentJob : JobSettings {
  std::string file;
  std::vector<std::string> devices;
  int jobs = 1;
  int gpus_per_run = 0;  // 0: as the runs' settings say
  long only = -1;
  double status_every = 60;  // seconds
  bool gathers = false, slurm = false, dry_run = false;
};

void visit_options(ExperimentJob& job, OptionList& option) {
  option("file", job.file, "the experiment (docs/guide/experiments.md)")
      .takes("FILE.toml")
      .required();
  option("--devices", job.devices,
         "distribute the runs over these devices [train.device of each run]")
      .takes("cuda:0,cuda:1,...")
      .commas();
  option("--jobs", job.jobs, "runs at a time on each device [1]").takes("N").between(1, kMostJobs);
  option("--gpus-per-run", job.gpus_per_run,
         "GPUs for each run, with consecutive numbers (docs/guide/several_gpus.md)")
      .takes("N")
      .between(1, kMostBatch);
  option("--only", job.only, "train this run only, numbered from 0 as in --dry-run")
      .takes("INDEX")
      .not_negative();
  option("--gather", job.gathers, "write the tables of the finished runs and train nothing")
      .excludes("--only");
  option("--slurm", job.slurm, "submit the unfinished runs to Slurm as a job array")
      .excludes("--only")
      .excludes("--gather");
  option("--dry-run", job.dry_run,
         "list the runs and train nothing; with --slurm, write the script without submitting it");
  option("--status-every", job.status_every,
         "without a terminal, seconds between two lines of progress; 0: none [60]")
      .takes("SECONDS")
      .not_negative();
  option("-q,--quiet", job.quiet, "print warnings and errors only");
}

using Runs = std::vector<const ExperimentRun*>;

Runs unfinished(const std::vector<ExperimentRun>& runs) {
  Runs result;
  for (const ExperimentRun& run : runs)
    if (!is_finished(run)) result.push_back(&run);
  return result;
}

std::vector<RunSlot> slots_of(const ExperimentJob& job) {
  return slots_on(job.devices, job.gpus_per_run, job.jobs);
}

bool work(const ExperimentJob& job, const Runs& runs, ExperimentProgress& progress) {
  const PoolEvents events = {
      [&](const auto& run, const auto& slot) { progress.started(run, slot); },
      [&](const auto& run, const auto& end, double seconds, const auto& error) {
        progress.ended(run, end, seconds, error);
      },
      [&](std::size_t running) { progress.waiting(running); }};
  return run_pool(runs, slots_of(job), events);
}

Error stopped(const ExperimentJob& job) {
  return Error(
      fmt::format("stopped by a signal; finished runs are kept, and `gemsplat experiment {}` "
                  "goes on with the other runs",
                  job.file),
      ExitCode::interrupted);
}

// What is said of runs that failed; empty if none did.
std::optional<Error> failure_of(const std::vector<FailedRun>& failures) {
  if (failures.empty()) return {};
  for (const FailedRun& failure : failures)
    log_error("{}: {}; log: {}", failure.run->name(), failure.why, failure.run->log().string());
  return Error(
      fmt::format("{} of the runs failed; run the command again to repeat them", failures.size()));
}

Json list_of(const std::vector<ExperimentRun>& runs) {
  Json list = Json::array();
  for (const ExperimentRun& run : runs)
    list.push_back({{"index", run.index}, {"name", run.name()}, {"is_finished", is_finished(run)}});
  return list;
}

Outcome tables_of(const Experiment& experiment, const std::vector<ExperimentRun>& runs,
                  std::size_t finished) {
  const std::string tables = (experiment.output / "results.md").string();
  const std::filesystem::path report = experiment.output / "report.html";
  Outcome outcome{
      fmt::format("{} of {} runs finished\ntables: {}\n", finished, runs.size(), tables),
      {{"finished", finished}, {"tables", tables}, {"runs", list_of(runs)}}};
  outcome.next = {{"read the tables", "less " + shell_word(tables)}};
  if (!std::filesystem::exists(report)) return outcome;
  outcome.text += fmt::format("report: {}\n", report.string());
  outcome.json["report"] = report.string();
  outcome.next = {{"look at it", "xdg-open " + shell_word(report.string())}};
  return outcome;
}

Outcome run_all(const ExperimentJob& job, const Experiment& experiment,
                const std::vector<ExperimentRun>& runs) {
  const OutputLock lock = OutputLock::of_folder(experiment.output);
  const Runs todo = unfinished(runs);
  log_info("{}: {} runs, {} finished already; output: {}", job.file, runs.size(),
           runs.size() - todo.size(), experiment.output.string());
  ExperimentProgress progress(experiment, runs, todo.size(), !job.quiet, job.status_every);
  progress.write();
  const bool is_whole = work(job, todo, progress);
  const std::size_t finished = progress.write();
  Outcome outcome = tables_of(experiment, runs, finished);
  outcome.failure = is_whole ? failure_of(progress.failures()) : stopped(job);
  return outcome;
}

// When all tasks have ended.
NextCommand gathering(const ExperimentJob& job) {
  return {"when all runs are finished",
          "gemsplat experiment " + shell_word(job.file) + " --gather"};
}

// Trains one run as a task of a job array. Other tasks work on the same output, so the tables are
// written later (--gather).
Outcome run_only(const ExperimentJob& job, const Experiment& experiment,
                 const std::vector<ExperimentRun>& runs) {
  if (std::size_t(job.only) >= runs.size())
    throw UsageError(fmt::format("--only {}: the runs of {} have the numbers 0 to {}", job.only,
                                 job.file, runs.size() - 1));
  const ExperimentRun& run = runs[std::size_t(job.only)];
  const OutputLock lock = OutputLock::of_folder(experiment.output, OutputLock::Kind::shared);
  if (is_finished(run)) {
    log_info("{} is finished already", run.name());
    return {"", list_of({run}), {gathering(job)}};
  }
  std::string why;
  StatusLog status(job.status_every);
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
  if (!run_pool({&run}, {slots_of(job).front()}, events)) throw stopped(job);
  if (!why.empty())
    throw Error(fmt::format("{} failed: {}; log: {}", run.name(), why, run.log().string()));
  log_info("{}: {}", run.name(), summary_of(run));
  return {"", list_of({run}), {gathering(job)}};
}

Outcome gather(const Experiment& experiment, const std::vector<ExperimentRun>& runs) {
  Outcome outcome = tables_of(experiment, runs, write_outcome(experiment, runs, {}));
  outcome.is_answer = true;
  const Runs missing = unfinished(runs);
  for (const ExperimentRun* run : missing)
    log_error("no results: {} {}; log: {}", run->index, run->name(), run->log().string());
  if (!missing.empty())
    outcome.failure.emplace(
        fmt::format("{} runs have no results; give --only with their number, or run the "
                    "command again",
                    missing.size()));
  return outcome;
}

Outcome list(const ExperimentJob& job, const std::vector<ExperimentRun>& runs) {
  Outcome outcome{"", {{"runs", list_of(runs)}}, {}, true};
  for (const ExperimentRun& run : runs)
    outcome.text += fmt::format("{:>4} {:<10} {}\n", run.index,
                                is_finished(run) ? "finished" : "to do", run.name());
  outcome.next = {{"train them", "gemsplat experiment " + shell_word(job.file)}};
  return outcome;
}

Outcome run(const ExperimentJob& job, JobEvents&) {
  const Experiment experiment = read_experiment(job.file);
  const std::vector<ExperimentRun> runs = runs_of(experiment);
  if (job.gathers) return gather(experiment, runs);
  if (job.slurm) {
    submit(experiment, unfinished(runs), job.gpus_per_run, job.dry_run);
    const std::string submission = "gemsplat experiment " + shell_word(job.file) + " --slurm";
    return {"",
            {{"runs", list_of(runs)}},
            {job.dry_run ? NextCommand{"submit it", submission} : gathering(job)}};
  }
  if (job.dry_run) return list(job, runs);
  return job.only >= 0 ? run_only(job, experiment, runs) : run_all(job, experiment, runs);
}

}  // namespace

Verb experiment_verb() {
  return verb_of<ExperimentJob>(
      "experiment", VerbGroup::compare,
      "Train scenes x configs x seeds of a file and write tables of the results",
      {"experiment caps.toml --dry-run", "experiment caps.toml --devices cuda:0,cuda:1",
       "experiment caps.toml --gather"});
}

}  // namespace gs
