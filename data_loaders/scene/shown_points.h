// SPDX-License-Identifier: Apache-2.0
// Which points of a scene its photos show, for programs that divide a scene by what cameras see.
#pragma once

#include <cstdint>
#include <vector>

#include "data_loaders/colmap/colmap_model.h"
#include "gs_core/camera.h"
#include "gs_core/scene.h"

namespace gs {

/// The indices of the points that each image shows.
using ShownPoints = std::vector<std::vector<std::uint32_t>>;

/// The points of each image's track, if the model was read with Tracks::read and has any. Else the
/// points in the picture of each of `cameras`, one for each image; they may be hidden by others.
/// `points` are those of the model.
ShownPoints shown_points(const ColmapModel& model, const std::vector<Camera>& cameras,
                         const std::vector<ScenePoint>& points);

/// Whether at least one of the images shows each of `point_count` points. `is_used`: (images) whose
/// points count.
std::vector<bool> points_shown_by(const ShownPoints& shown, const std::vector<bool>& is_used,
                                  std::size_t point_count);

}  // namespace gs
