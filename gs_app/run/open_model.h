// SPDX-License-Identifier: Apache-2.0
// A trained model as users name it: a file of any format that is read, or the folder of a run.
#pragma once

#include <filesystem>
#include <optional>

#include "data_loaders/formats/sidecar.h"
#include "gs_app/run/run_folder.h"
#include "gs_core/config/config.h"
#include "gs_core/gaussians.h"
#include "gs_core/scene.h"
#include "gs_render/render_pass.h"

namespace gs {

struct OpenedModel {
  std::filesystem::path ply;  // or a file of another format
  std::optional<RunFolder> run;  // where a folder was named
  GaussianModel model;
  Config config;  // the run's, but its [train], or the defaults; SH degree, antialiasing and, where another
                  // trainer wrote it, the classic blending rule of the PLY
};

/// Opens `path` (formats.h); of a run's folder the newest PLY, or that of `step`. Throws Error where there is none.
OpenedModel open_model(const std::filesystem::path& path, std::optional<int> step);

/// The scene at dataset.source in the model's frame; with the exposures that the run was trained with, where it has any
/// and the scene is its own.
Scene scene_for(const OpenedModel& opened, DatasetConfig dataset, bool is_other_scene);

/// How to render the model under a config: never more SH degrees than it has, black for "random".
RenderSettings view_settings(const OpenedModel& opened, Config config);

}  // namespace gs
