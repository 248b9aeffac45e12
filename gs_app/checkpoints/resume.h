// SPDX-License-Identifier: Apache-2.0
// `gemsplat train --resume`: which run to go on with, from which checkpoint, with which settings.
// docs/reference/checkpoints.md
#pragma once

#include <filesystem>
#include <functional>
#include <optional>
#include <string>
#include <vector>

#include "gs_app/checkpoints/checkpoint_file.h"
#include "gs_app/run/run_folder.h"

namespace gs {

/// The run that `--resume` found, as its last checkpoint has it.
struct ResumedRun {
  Checkpoint checkpoint;
  Config config;                    // of the steps that are left
  std::filesystem::path source;     // the run's folder; model.output may name another one
  bool is_finished = false;         // its results are written, and no steps were added
  bool is_extended = false;         // steps were added by this call
  bool finishes_extension = false;  // steps were to be added, and those added before are not done

  /// Whether the run goes on in the folder that it was started in.
  bool goes_on_in_place() const;
};

/// Applies what was asked for now (flags, settings, config files) over a config, and validates the
/// result.
using SettingsOver = std::function<Config(const Config& start)>;

/// Removes `train.iterations=+N` from a list of settings. Returns N, or 0 where there is none.
/// Throws UsageError.
int extract_added_steps(std::vector<std::string>& settings);

/// Finds the run to go on with. `where` is "auto" for the run in the output folder (none is
/// returned where it holds no checkpoint), a run's folder, or a checkpoint. Settings that
/// `settings` does not name stay as they were in the run. Throws UsageError that lists the settings
/// that differ although a run keeps them. `part` is what is read of its checkpoint.
std::optional<ResumedRun> find_resumed_run(const SettingsOver& settings, const std::string& where,
                                           int added_steps, CheckpointPart part);

/// Throws Error where the scene is not the one that the run was trained on.
/// `scene` is its record, `source` its name for messages.
void check_same_scene(const ResumedRun& run, const SceneRecord& scene, const std::string& source);

/// Whether the run's cameras or exposures were solved for. The last bits of a solver's result may
/// differ from one machine to another, so that such a run goes on with those in its checkpoint.
bool has_solved_views(const ResumedRun& run);

/// Gives the scene the cameras, exposures, extent and offset that the checkpoint holds.
/// check_same_scene() comes first.
void restore_scene(const ResumedRun& run, Scene& scene);

/// Moves the folder aside (move_run_aside()) if a killed run has left models or results there. A run
/// that was killed before that stays, so that a scene that was made from its photos is kept.
void move_trained_run_aside(const RunFolder& folder, OutputLock& lock,
                            const std::vector<std::filesystem::path>& needed);

/// Makes the folder ready for a start from step 0 where there is no checkpoint. What a killed run has
/// left there is moved aside with the folder, unless this run writes the same files at once. The
/// folder stays, and only config.toml is renamed to config.toml.bak-N, if it holds a scene that was
/// made from the photos (`holds_made_scene`), or a run that saved nothing and could have been resumed
/// with these settings. Throws UsageError if a path of `needed` would have
/// to move.
void prepare_fresh_start(const RunFolder& folder, const Config& config, OutputLock& lock,
                         const std::vector<std::filesystem::path>& needed, bool holds_made_scene);

/// Makes the folder ready to go on in. Results of fewer steps, checkpoints that are newer than the
/// one taken, and a config.toml whose settings have changed are renamed to FILE.bak-N. What killed
/// processes left is removed.
void prepare_resumed_folder(const RunFolder& folder, const ResumedRun& run);

}  // namespace gs
