// SPDX-License-Identifier: Apache-2.0
// One run of an experiment: its folder, whether it is finished, and the command that does it.
#pragma once

#include <filesystem>
#include <string>
#include <vector>

#include "gs_app/experiment/experiment_file.h"
#include "gs_app/run/run_folder.h"

namespace gs {

/// One scene, config and seed. Index: its place in the order scene, config, seed (fastest), from 0.
struct ExperimentRun {
  std::size_t index = 0;
  std::string scene, config;
  std::uint64_t seed = 0;
  Config settings;
  RunFolder folder{{}};  // OUTPUT/SCENE/CONFIG/seedN

  std::string name() const;  // "scene/config/seedN", as in the output folder
  std::filesystem::path log() const { return folder.root() / "train.log"; }
  /// The settings that the run in the folder was started with.
  std::filesystem::path settings_file() const { return folder.root() / "settings.toml"; }
  std::filesystem::path lock() const;
};

/// All runs, in order. Throws UsageError where the settings of one cannot be used.
std::vector<ExperimentRun> runs_of(const Experiment& experiment);

/// Whether the folder has the results of a run with these settings. Settings that change no result
/// may differ: train.threads, train.log_every and the like (OnChange::nothing in config_fields.h).
bool is_finished(const ExperimentRun& run);

/// Where a run is computed; what is empty or 0 is left to the settings.
struct RunSlot {
  std::string device;
  int threads = 0;
};

/// Makes the folder ready for the run: another run that it holds, or one that broke off and cannot
/// be resumed, is moved to FOLDER.bak-N; settings.toml is written. Throws Error.
void prepare(const ExperimentRun& run);

/// `gemsplat train` with the run's settings, for start_child().
std::vector<std::string> train_command(const ExperimentRun& run, const RunSlot& slot);

}  // namespace gs
