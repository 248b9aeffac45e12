// SPDX-License-Identifier: Apache-2.0
// What the depth maps of a scene hold, by the sparse points: dataset.depth_kind = "auto".
#pragma once

#include <string>
#include <vector>

#include "data_loaders/scene/depth/depth_agreement.h"
#include "data_loaders/scene/plan_views.h"
#include "gs_core/scene.h"

namespace gs {

/// Reads up to kMapsLookedAt maps, evenly chosen, and takes the points that each photo shows. Where
/// a model does not tell, it takes all points in the picture; ranks and medians bear many that
/// something else hides.
DepthAgreement depth_agreement(const std::vector<ViewPlan>& plans,
                               const std::vector<ScenePoint>& points);
inline constexpr std::size_t kMapsLookedAt = 8;

/// "depth in world units" and so on.
std::string text_of(DepthKind kind);

}  // namespace gs
