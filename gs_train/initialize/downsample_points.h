// SPDX-License-Identifier: Apache-2.0
// Downsampling of point clouds that are too dense to start training from.
#pragma once

#include <vector>

#include "gs_core/scene.h"

namespace gs {

/// At most `budget` of the points, in their order; all of them where they are no more than that.
/// Otherwise the points' bounding cube is halved along each axis, again and again, and the first
/// point of each occupied cell stays, of the finest grid that leaves at most `budget` points.
/// Non-finite points have no cell and are dropped.
///
/// For example, 5,000 points on a plane and a budget of 1,000 leave between 250 and 1,000 points,
/// evenly spaced.
std::vector<ScenePoint> downsampled(const std::vector<ScenePoint>& points, std::size_t budget);

}  // namespace gs
