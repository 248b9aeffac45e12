// SPDX-License-Identifier: Apache-2.0
// Rows in Morton order: neighbors in space become neighbors in the file, which then compresses
// well.
#pragma once

#include <cstdint>
#include <vector>

#include "gs_core/gaussians.h"

namespace gs {

/// The rows of these means along the Morton curve through their bounding box. Rows with equal codes
/// keep their order.
std::vector<std::uint32_t> morton_order(const Buffer<Vec3f>& means);

/// A copy with rows in this order.
GaussianModel in_morton_order(const GaussianModel& model);

}  // namespace gs
