// SPDX-License-Identifier: Apache-2.0
// Rows in Morton order: neighbors in space become neighbors in the file, which compresses them well.
#pragma once

#include "gs_core/gaussians.h"

namespace gs {

/// A copy whose rows lie along the Morton curve in the bounding box of the means. Equal codes keep their order.
GaussianModel in_morton_order(const GaussianModel& model);

}  // namespace gs
