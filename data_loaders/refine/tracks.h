// SPDX-License-Identifier: Apache-2.0
// Which photos show which points.
#pragma once

#include <cstdint>
#include <string>
#include <vector>

#include "data_loaders/colmap/colmap_model.h"
#include "data_loaders/lenses/lens.h"

namespace gs {

/// A point of the model in one of its images.
struct SeenPoint {
  std::uint32_t point = 0;  // index in model.points
  Vec2d pixel{0.0, 0.0};    // of the camera's size, the center of the first at (0.5, 0.5)
};

/// What each image shows, in the images' order, from the observations of a model read with Tracks::read. Those of
/// points that the model does not have are left out. `option` is what the user asked for. Throws Error where
/// no image shows any point, with advice.
std::vector<std::vector<SeenPoint>> seen_points(const ColmapModel& model,
                                                const std::string& option);

}  // namespace gs
