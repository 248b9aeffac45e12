// SPDX-License-Identifier: Apache-2.0
// Rows in Morton order: neighbors in space become neighbors in the file, which then compresses
// well.
#pragma once

#include "gs_core/gaussians.h"

namespace gs {

/// A copy with rows along the Morton curve through the bounding box of the means. Rows with equal
/// codes keep their order.
GaussianModel in_morton_order(const GaussianModel& model);

}  // namespace gs
