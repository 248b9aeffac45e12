// SPDX-License-Identifier: Apache-2.0
// One run of an experiment: its folder, whether it is finished, and the command that trains it.
#pragma once

#include <filesystem>
#include <string>
#include <vector>

#include "gs_app/experiment/experiment_file.h"
#include "gs_app/run/run_folder.h"

namespace gs {

/// One scene, config and seed. Runs are numbered from 0; the seed changes fastest, then the config,
/// then the scene.
struct ExperimentRun {
  std::size_t index = 0;
  std::string scene, config;
  std::uint64_t seed = 0;
  Config settings;
  RunFolder folder{{}};  // OUTPUT/SCENE/CONFIG/seedN

  std::string name() const;  // "scene/config/seedN", as in the output folder
  std::filesystem::path log() const { return folder.root() / "train.log"; }
  /// The settings with which the run in the folder was started.
  std::filesystem::path settings_file() const { return folder.root() / "settings.toml"; }
};

/// All runs, in order. Throws UsageError if the settings of one are not valid.
std::vector<ExperimentRun> runs_of(const Experiment& experiment);

/// Whether the folder has the results of a run with these settings. Settings that do not affect the
/// result may differ: train.threads, train.log_every and the like (OnChange::nothing in
/// config_fields.h).
bool is_finished(const ExperimentRun& run);

/// Where a run is trained. What is empty or 0 is up to the run's settings.
struct RunSlot {
  std::string device;  // the first one, if there are several GPUs
  int threads = 0;
  int gpus = 0;  // train.ranks
};
/// `jobs` slots on each device, or on each group of so many GPUs that follow each other; without
/// devices as if there were one of them. All slots share the machine's threads evenly. Throws
/// UsageError where the devices are no such groups.
std::vector<RunSlot> slots_on(const std::vector<std::string>& devices, int gpus_per_run, int jobs);

/// Prepares the folder: moves a run with other settings, or one that left models and no checkpoint,
/// to FOLDER.bak-N, and writes settings.toml.
/// Throws Error, also while another process trains into the folder.
void prepare(const ExperimentRun& run);

/// The command `gemsplat train` with the run's settings, for start_child(). It resumes a run that
/// the folder holds.
std::vector<std::string> train_command(const ExperimentRun& run, const RunSlot& slot);

}  // namespace gs
