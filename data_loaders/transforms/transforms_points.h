// SPDX-License-Identifier: Apache-2.0
// The points of a scene with transforms.json; used by transforms_json.cpp only.
#pragma once

#include <vector>

#include "data_loaders/colmap/colmap_model.h"
#include "data_loaders/transforms/transforms_file.h"

namespace gs {

/// The points of the file that ply_file_path names, a PLY or what else read_point_file() reads. None,
/// with a warning, if it cannot be read, and none if no file is named. Throws Error for a path that is
/// not one.
std::vector<ColmapPoint> read_transforms_points(const TransformsFile& file);

}  // namespace gs
