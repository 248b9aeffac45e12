// SPDX-License-Identifier: Apache-2.0
// Cameras to look at a model from: those of a file, of a run or of a scene. Each is moved to the coordinates of a model whose
// world offset is given.
#pragma once

#include <filesystem>
#include <string>
#include <vector>

#include "data_loaders/cameras/camera_file.h"
#include "gs_app/run/run_folder.h"
#include "gs_core/config/config.h"

namespace gs {

/// The cameras of a file or folder (read_cameras.h), in pictures smaller by `resolution`. Throws Error.
std::vector<NamedCamera> cameras_of_file(const std::filesystem::path& file, int resolution,
                                         const Vec3d& world_offset);

/// The run's own cameras, those of its training or test views where asked (`split`: train, test, all). Throws Error.
std::vector<NamedCamera> cameras_of_run(const RunFolder& run, int resolution,
                                        const std::string& split, const Vec3d& world_offset);

/// The cameras of a scene, split as training on it would. Throws Error.
std::vector<NamedCamera> cameras_of_scene(DatasetConfig dataset, const std::string& split,
                                          const Vec3d& world_offset);

/// The camera at another picture size, its pixels still as high as they are wide: all that it shows stays in the picture, and
/// where the shape is another one, more of the scene is seen beside it.
Camera reframed(Camera camera, int width, int height);

/// The camera with square pixels and this angle across the picture's width, its axis through the middle.
Camera with_field_of_view(Camera camera, double degrees);

}  // namespace gs
