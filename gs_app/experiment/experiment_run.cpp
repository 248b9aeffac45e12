// SPDX-License-Identifier: Apache-2.0
#include "gs_app/experiment/experiment_run.h"

#include <spdlog/fmt/fmt.h>

#include <algorithm>

#include "gs_app/run/make_backend.h"
#include "gs_core/config/config_diff.h"
#include "gs_core/error.h"
#include "gs_core/system/files/access.h"
#include "gs_core/system/files/output_lock.h"
#include "gs_core/system/log.h"
#include "gs_core/system/processes/process.h"
#include "gs_core/threads/parallel.h"

namespace gs {
namespace {

namespace fs = std::filesystem;

// Whether the folder holds a run that gives the result of this one. A settings file that is
// missing, or that this version cannot read, belongs to another run.
bool has_same_settings(const ExperimentRun& run) {
  if (!fs::exists(run.settings_file())) return false;
  Config written;
  try {
    load_config(written, run.settings_file());
  } catch (const AccessError&) {  // else a run that cannot be read now would be moved away
    throw;
  } catch (const Error&) {
    return false;
  }
  return same_result(written, run.settings);
}

// Whether a killed run has left models and nothing to go on from. Training would move the folder
// away, and settings.toml with it.
bool has_only_models(const RunFolder& folder) {
  const std::vector<fs::path> kept = entries_of(folder.checkpoints());
  return folder.newest_step() && !fs::exists(folder.results()) &&
         std::ranges::none_of(kept,
                              [](const fs::path& file) { return file.extension() == ".ckpt"; });
}

// The number of a GPU of --devices.
int number_of(const std::string& device) {
  if (const std::optional<int> number = gpu_number(device)) return *number;
  throw UsageError(fmt::format(
      "--gpus-per-run needs the numbers of GPUs, --devices cuda:0,cuda:1,..., and not {}", device));
}

ExperimentRun make_run(const Experiment& experiment, const ExperimentScene& scene,
                       const ExperimentConfig& config, std::uint64_t seed) {
  ExperimentRun run;
  run.scene = scene.name;
  run.config = config.name;
  run.seed = seed;
  run.settings = settings_of(experiment, scene, config, seed);
  run.folder = RunFolder(experiment.output / run.name());
  return run;
}

}  // namespace

std::string ExperimentRun::name() const { return fmt::format("{}/{}/seed{}", scene, config, seed); }

std::vector<ExperimentRun> runs_of(const Experiment& experiment) {
  std::vector<ExperimentRun> runs;
  for (const ExperimentScene& scene : experiment.scenes)
    for (const ExperimentConfig& config : experiment.configs)
      for (const std::uint64_t seed : experiment.seeds) {
        runs.push_back(make_run(experiment, scene, config, seed));
        runs.back().index = runs.size() - 1;
      }
  return runs;
}

bool is_finished(const ExperimentRun& run) {
  return fs::exists(run.folder.results()) && has_same_settings(run);
}

void prepare(const ExperimentRun& run) {
  OutputLock lock = OutputLock::of_folder(run.folder.root());
  if (run.folder.holds_run() && (!has_same_settings(run) || has_only_models(run.folder))) {
    const fs::path backup = lock.move_folder_aside({run.settings.dataset.source});
    log_info("{}: the earlier run is now in {}", run.name(), backup.string());
  }
  write_text(run.settings_file(), to_toml(run.settings));
}

std::vector<RunSlot> slots_on(const std::vector<std::string>& devices, int gpus_per_run, int jobs) {
  const std::size_t group = std::size_t(std::max(gpus_per_run, 1));
  if (devices.size() % group != 0)
    throw UsageError(
        fmt::format("--gpus-per-run {}: give a multiple of this number of GPUs in "
                    "--devices; there are {}",
                    group, devices.size()));
  std::vector<RunSlot> of_job;
  for (std::size_t first = 0; first < devices.size(); first += group) {
    for (std::size_t k = 1; k < group; ++k)
      if (devices[first + k] != fmt::format("cuda:{}", number_of(devices[first]) + int(k)))
        throw UsageError(
            fmt::format("--gpus-per-run {}: the GPUs of a run follow each other, and "
                        "{} is not the GPU after {}",
                        group, devices[first + k], devices[first + k - 1]));
    of_job.push_back({devices[first]});
  }
  if (devices.empty()) of_job.push_back({gpus_per_run > 0 ? "cuda" : ""});
  std::vector<RunSlot> slots;
  for (int job = 0; job < jobs; ++job) slots.insert(slots.end(), of_job.begin(), of_job.end());
  const int threads = slots.size() > 1 ? std::max(1, thread_count() / int(slots.size())) : 0;
  for (RunSlot& slot : slots) slot.threads = threads, slot.gpus = gpus_per_run;
  return slots;
}

std::vector<std::string> train_command(const ExperimentRun& run, const RunSlot& slot) {
  std::vector<std::string> command = {
      program_to_start().string(),  "train", "-c",
      run.settings_file().string(), "-o",    run.folder.root().string()};
  if (!slot.device.empty()) command.insert(command.end(), {"--device", slot.device});
  if (slot.gpus > 0)
    command.insert(command.end(), {"--set", fmt::format("train.ranks={}", slot.gpus)});
  if (slot.threads > 0) command.insert(command.end(), {"--threads", std::to_string(slot.threads)});
  if (has_same_settings(run)) command.insert(command.end(), {"--resume", "auto"});
  return command;
}

}  // namespace gs
