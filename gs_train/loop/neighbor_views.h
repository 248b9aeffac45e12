// SPDX-License-Identifier: Apache-2.0
// Which photos show the same surfaces from beside each other, so that their patches can be compared.
#pragma once

#include <cstdint>
#include <vector>

#include "gs_core/scene.h"

namespace gs {

inline constexpr std::size_t kMostNeighbors = 8;

/// For each view the indices of up to kMostNeighbors others, the best ones first. Their axes are at
/// most 30 degrees apart, and the best see many points from some 5 degrees beside. Where there are
/// no points they are the nearest ones.
std::vector<std::vector<std::uint32_t>> neighbor_views(const std::vector<View>& views,
                                                       const std::vector<ScenePoint>& points);

}  // namespace gs
