// SPDX-License-Identifier: Apache-2.0
// The points of a LAS; used by point_file.cpp only.
#pragma once

#include <filesystem>
#include <vector>

#include "data_loaders/colmap/colmap_model.h"

namespace gs {

/// Positions, and colors where the points have them, of LAS 1.0 to 1.4 with the point formats 0 to
/// 10. Points that the file calls withheld or noise are left out. Throws Error that names the file
/// and a remedy, also for a LAZ.
std::vector<ColmapPoint> read_las_points(const std::filesystem::path& path);

}  // namespace gs
