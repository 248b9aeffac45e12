// SPDX-License-Identifier: Apache-2.0
// Dense point clouds, thinned to what training can start from.
#pragma once

#include <vector>

#include "gs_core/scene.h"

namespace gs {

/// One point of each occupied cell of the finest grid of halved cubes that leaves at most `budget` points: the one that
/// comes first. The points keep their order; all of them stay where they are no more than `budget`, and non-finite
/// ones, which have no cell, go first.
std::vector<ScenePoint> thinned(const std::vector<ScenePoint>& points, std::size_t budget);

}  // namespace gs
