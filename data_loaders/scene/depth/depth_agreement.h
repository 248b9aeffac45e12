// SPDX-License-Identifier: Apache-2.0
// What the sparse points say of a scene's depth maps.
#pragma once

#include <cstddef>

#include "gs_core/math/loss/depth_kind.h"

namespace gs {

/// How the values of some maps go with the depths of the sparse points in their photos.
struct DepthAgreement {
  std::size_t maps = 0;  // that were looked at and show enough points
  double correlation =
      0;  // mean rank correlation with the depths: 1 as depths, -1 as inverse depths
  // Of value / depth, over all points: the median in units of the plan (1: metric), and the median
  // deviation of its logarithm from the median of its photo (0: one factor a photo)
  double ratio = 0, spread = 0;

  /// The kind that this means. `automatic` where the maps do not go with the points.
  DepthKind kind() const;
};

}  // namespace gs
