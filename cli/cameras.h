// SPDX-License-Identifier: Apache-2.0
// Cameras to look at a model from: those of a file, of a run or of a scene. Each is moved to the coordinates of a model whose
// world offset is given.
#pragma once

#include <filesystem>
#include <string>
#include <vector>

#include "data_loaders/camera_file.h"
#include "gs_api/run_folder.h"
#include "gs_core/config.h"

namespace gs {

/// The cameras of a cameras.json, in pictures smaller by `resolution`. Throws Error.
std::vector<NamedCamera> cameras_of_file(const std::filesystem::path& file, int resolution,
                                         const Vec3d& world_offset);

/// The run's own cameras, those of its training or test views where asked (`split`: train, test, all). Throws Error.
std::vector<NamedCamera> cameras_of_run(const RunFolder& run, int resolution,
                                        const std::string& split, const Vec3d& world_offset);

/// The cameras of a scene, split as training on it would. Throws Error.
std::vector<NamedCamera> cameras_of_scene(DatasetConfig dataset, const std::string& split,
                                          const Vec3d& world_offset);

}  // namespace gs
