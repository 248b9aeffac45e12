// SPDX-License-Identifier: Apache-2.0
// What the depth maps of a scene hold, by the sparse points: dataset.depth_kind = "auto".
#pragma once

#include <string>
#include <vector>

#include "data_loaders/scene/photo.h"
#include "gs_core/math/loss/depth_kind.h"
#include "gs_core/scene.h"

namespace gs {

/// How the values of some maps go with the depths of the sparse points in their photos.
struct DepthAgreement {
  std::size_t maps = 0;  // that were looked at and show enough points
  double correlation =
      0;  // mean rank correlation with the depths: 1 as depths, -1 as inverse depths
  // Of value / depth, over all points: the median in units of the map (1: metric), and the median
  // deviation of its logarithm from the median of its photo (0: one factor a photo)
  double ratio = 0, spread = 0;

  /// The kind that this means. `automatic` where the maps do not go with the points.
  DepthKind kind() const;
};

/// Reads up to kMapsLookedAt maps, evenly chosen, and takes the points that each photo shows. Where
/// a model does not tell, it takes all points in the picture; ranks and medians bear many that
/// something else hides.
DepthAgreement depth_agreement(const std::vector<Photo>& photos,
                               const std::vector<ScenePoint>& points);
inline constexpr std::size_t kMapsLookedAt = 8;

/// "depth in world units" and so on.
std::string text_of(DepthKind kind);

}  // namespace gs
