// SPDX-License-Identifier: Apache-2.0
// A trained model as users name it: a file of any format that can be read, or the folder of a run.
#pragma once

#include <filesystem>
#include <optional>

#include "gs_app/run/run_folder.h"
#include "gs_core/config/config.h"
#include "gs_core/gaussians.h"
#include "gs_core/scene.h"
#include "gs_model/formats/sidecar.h"
#include "gs_render/render_pass.h"

namespace gs {

struct OpenedModel {
  std::filesystem::path ply;     // or a file of another format
  std::optional<RunFolder> run;  // where a folder was named
  GaussianModel model;
  // From the model's numbers to the photos' frame, where the file was turned or scaled, or moved by
  // `gemsplat edit`. Elsewhere that is a shift by the world offset.
  std::optional<Mat4d> input_from_model = {};
  // the run's, but its [train], or the defaults; SH degree, antialiasing and, where another trainer
  // wrote it, the classic blending rule of the PLY
  Config config;
};

/// Opens a file of any format that can be read (formats.h), or a folder of SOG files. In a run's
/// folder this is the newest PLY, or the PLY after `step`. Throws Error if there is none.
OpenedModel open_model(const std::filesystem::path& path, std::optional<int> step);

/// Throws UsageError where the model has no time.
void check_has_time(const OpenedModel& opened);
/// Puts the model's moment `time`, 0 to 1, in its place, as 3D Gaussians (model_moment.h). Throws
/// UsageError where the model has no time.
void take_moment(OpenedModel& opened, double time);

/// The scene at dataset.source in the model's frame. A run's own scene gets the exposures that the
/// run was trained with, and the poses that it has refined, if there are any.
Scene scene_for(const OpenedModel& opened, DatasetConfig dataset, bool is_other_scene);
/// The same with `offset` as its world offset, for a model in the photos' frame. `run` may be null.
Scene scene_for(const RunFolder* run, DatasetConfig dataset, bool is_other_scene,
                const Vec3d& offset);

/// The settings for rendering the model with a config. The SH degree is at most that of the model,
/// and a random background becomes black.
RenderSettings view_settings(const OpenedModel& opened, Config config);

/// The same with the model's own SH degree: what a lower degree loses counts.
RenderSettings settings_of_model(const OpenedModel& opened, Config config);

}  // namespace gs
