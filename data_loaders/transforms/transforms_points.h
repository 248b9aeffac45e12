// SPDX-License-Identifier: Apache-2.0
// The points of a scene with transforms.json; used by transforms_json.cpp only.
#pragma once

#include <vector>

#include "data_loaders/colmap/colmap_model.h"
#include "data_loaders/transforms/transforms_file.h"

namespace gs {

/// The points of the PLY that the file names in ply_file_path; gray if the PLY has no colors.
/// None, with a warning, if the PLY cannot be read, and none if the file names no PLY. Points that
/// are not finite are left out. Throws Error for a path that is not one.
std::vector<ColmapPoint> read_transforms_points(const TransformsFile& file);

}  // namespace gs
