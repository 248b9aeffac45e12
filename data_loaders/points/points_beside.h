// SPDX-License-Identifier: Apache-2.0
// Points for cameras of a program that exports both, in two files.
#pragma once

#include <filesystem>
#include <vector>

#include "data_loaders/colmap/colmap_model.h"

namespace gs {

/// The points of the one PLY or LAS in the folder of a file with cameras, or else in the next folder
/// above it that has one, up to the scene's. A cloud goes before a mesh, whose corners are points,
/// too. None, with a warning that names the files, if there are several or one that cannot be read,
/// and if the cameras see less than half of the points: these have other coordinates then.
std::vector<ColmapPoint> points_beside(const ColmapModel& cameras,
                                       const std::filesystem::path& scene,
                                       const std::filesystem::path& file);

}  // namespace gs
