// SPDX-License-Identifier: Apache-2.0
// Writes COLMAP models, in the binary encoding that read_colmap_model() and COLMAP read.
#pragma once

#include <filesystem>

#include "data_loaders/colmap/colmap_model.h"

namespace gs {

/// Writes cameras, images, points3D and, if the model has any, rigs and frames. Tracks of points
/// are those of the images' observations. cameras.bin is written last: without it the folder is not
/// a model. Makes the folder if it does not exist. Throws Error with the path if the disk is full.
void write_colmap_model(const std::filesystem::path& folder, const ColmapModel& model);

}  // namespace gs
