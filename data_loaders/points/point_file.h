// SPDX-License-Identifier: Apache-2.0
// Clouds of points, as photogrammetry and laser scanners write them.
#pragma once

#include <filesystem>
#include <vector>

#include "data_loaders/colmap/colmap_model.h"

namespace gs {

inline constexpr std::size_t kMostPointsOfFile = 20'000'000;  // of a file that has more

/// The points of a PLY or a LAS, by the file's ending: positions in double precision, since they may
/// be those of a map, and colors, gray where there are none. Of a file with more than
/// kMostPointsOfFile, every second, third, ... point is taken. Points that are not finite are left
/// out, with a warning. Throws Error that names the file and a remedy, also for a LAZ, which is
/// compressed.
std::vector<ColmapPoint> read_point_file(const std::filesystem::path& path);

/// What a file is, by its ending and the beginning of a PLY. Never throws.
enum class PointFileKind {
  none,    // of no points; also a PLY with Gaussians, and one without rows
  mesh,    // a PLY with faces
  points,  // a PLY, a LAS or a LAZ
};
PointFileKind point_file_kind(const std::filesystem::path& path);

}  // namespace gs
