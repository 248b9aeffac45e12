// SPDX-License-Identifier: Apache-2.0
// Where most of a set of positions lie, and which positions are far away from all others: mostly
// cameras whose poses are wrong.
#pragma once

#include <cstddef>
#include <vector>

#include "gs_core/types.h"

namespace gs {

/// The median of each coordinate by itself, so that a few outliers cannot move it. (0, 0, 0) for no
/// positions.
Vec3d median_position(const std::vector<Vec3d>& positions);

/// The distance from `center` that nine in ten positions do not exceed; 0 for no positions.
double ordinary_distance(const Vec3d& center, const std::vector<Vec3d>& positions);

/// Positions more than ten times as far from the median position as nine in ten are. Indices,
/// ascending; at most a tenth of all.
std::vector<std::size_t> outlier_positions(const std::vector<Vec3d>& positions);

}  // namespace gs
