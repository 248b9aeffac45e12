// SPDX-License-Identifier: Apache-2.0
// Positions far away from all others: mostly of cameras whose poses are wrong.
#pragma once

#include <cstddef>
#include <vector>

#include "gs_core/types.h"

namespace gs {

/// Those more than ten times as far from the median position as nine in ten. Indices, ascending; at most a tenth of all.
std::vector<std::size_t> outlier_positions(const std::vector<Vec3d>& positions);

}  // namespace gs
