// SPDX-License-Identifier: Apache-2.0
// What a pixel counts for in a score pass of density control.
#pragma once

#include "gs_core/math/density/growth.h"

namespace gs {

/// The values of pixels that a score pass sums over fragments.
///
///   error   mean over the channels of |render - photo|
///   mask    1 where that is above `mask_error` of its range in the photo, else 0
///   edge    |3 x 3 Laplacian| of the gray photo, in its range
struct PixelRule {
  GrowthScore score = GrowthScore::error;
  float mask_error = 0;

  bool operator==(const PixelRule&) const = default;
};

}  // namespace gs
