// SPDX-License-Identifier: Apache-2.0
// Cameras of a file, of a run or of a scene, to render a model from. They are moved into the
// coordinates of a model with the given world offset.
#pragma once

#include <filesystem>
#include <string>
#include <vector>

#include "data_loaders/cameras/camera_file.h"
#include "gs_app/run/run_folder.h"
#include "gs_core/config/config.h"

namespace gs {

/// The cameras of a file or folder (read_cameras.h), for pictures `resolution` times smaller.
/// Throws Error.
std::vector<NamedCamera> cameras_of_file(const std::filesystem::path& file, int resolution,
                                         const Vec3d& world_offset);

/// The run's own cameras: those of a `split` (train, test, all). Throws Error.
std::vector<NamedCamera> cameras_of_run(const RunFolder& run, int resolution,
                                        const std::string& split, const Vec3d& world_offset);

/// The cameras of a scene, split as training on it would. Sizes are those of the photos, which are
/// not decoded; masks are not looked for. Throws Error.
std::vector<NamedCamera> cameras_of_scene(DatasetConfig dataset, const std::string& split,
                                          const Vec3d& world_offset);

/// The camera with another picture size. Pixels keep their shape and all that was visible stays in
/// the picture; a picture of another shape shows more of the scene at its sides.
Camera reframed(Camera camera, int width, int height);

/// The pinhole with square pixels, this angle across the picture's width, and its axis through the
/// middle.
Camera with_field_of_view(Camera camera, double degrees);

}  // namespace gs
