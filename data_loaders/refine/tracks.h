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

/// Whether an image of the model says which points it shows. False for one that was read with
/// Tracks::skip.
bool has_tracks(const ColmapModel& model);

/// The points that each image shows, in the order of the images. The model was read with
/// Tracks::read. Observations of points that the model lacks are left out. Throws Error with advice
/// where no image shows any point; it names `option`, which the user gave.
std::vector<std::vector<SeenPoint>> seen_points(const ColmapModel& model,
                                                const std::string& option);

}  // namespace gs
