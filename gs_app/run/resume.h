// SPDX-License-Identifier: Apache-2.0
// gemsplat train --resume: which run to go on with, from which checkpoint, under which settings. docs/checkpoints.md
#pragma once

#include <filesystem>
#include <functional>
#include <optional>
#include <string>
#include <vector>

#include "gs_app/run/checkpoint_file.h"
#include "gs_app/run/run_folder.h"

namespace gs {

/// What `--resume` found.
struct ResumedRun {
  Checkpoint checkpoint;
  Config config;                 // of what is left of the run
  std::filesystem::path source;  // the run's folder; model.output may be another
  bool is_finished = false;      // with its results written, and no steps added
  bool is_extended = false;      // steps were added just now

  bool goes_on_in_place() const;
};

/// Applies what was asked for now (flags, settings, config files) over a config, and validates it.
using SettingsOver = std::function<Config(const Config& start)>;

/// Takes `train.iterations=+N` out of a list of settings. Returns N, or 0 where there is none. Throws UsageError.
int take_added_steps(std::vector<std::string>& settings);

/// The run to go on with: the one in the output folder ("auto"; none where there is nothing to resume), or in the folder,
/// or of the checkpoint, that is named. What `settings` does not say is as in the run. Throws UsageError that names
/// the settings that a run keeps and that differ.
std::optional<ResumedRun> find_run(const SettingsOver& settings, const std::string& where,
                                   int added_steps);

/// Checks that the scene is the one of the run, and gives it the run's cameras and exposures where these were solved for:
/// a solver's last bits may differ. Throws Error.
void adopt_scene(const ResumedRun& run, Scene& scene);

/// Makes the folder for a start from the beginning. What a killed run left there without a checkpoint is moved aside,
/// where it is anything that this run would not write again at once.
void prepare_fresh_start(const RunFolder& folder, const Config& config);

/// Makes the run's folder ready to go on in: results of fewer steps, and newer checkpoints than the one taken, are renamed
/// to FILE.bak-N; so is config.toml, where settings have changed. What killed processes left is removed.
void prepare_folder(const RunFolder& folder, const ResumedRun& run);

}  // namespace gs
