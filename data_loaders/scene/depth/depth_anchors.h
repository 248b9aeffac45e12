// SPDX-License-Identifier: Apache-2.0
// Scale and shift of a photo's depth map, by the sparse points that the photo shows.
#pragma once

#include <optional>
#include <vector>

#include "data_loaders/colmap/colmap_model.h"
#include "data_loaders/scene/plan_views.h"
#include "gs_core/math/loss/depth_loss.h"

namespace gs {

/// Gives each plan with a map the points that its photo shows, where the view's camera sees them.
/// The model was read with Tracks::read; photos of models without tracks get none.
void add_depth_anchors(const ColmapModel& model, std::vector<ViewPlan>& plans);

/// Whether a plan has enough anchors for scale and shift.
bool is_anchored(const ViewPlan& plan);

/// Scale and shift of the map, which has the view's size: they minimize the sum of the absolute
/// errors of inverse depth at the anchors (math/depth_loss.h), so that some wrong points do no
/// harm. None where too few anchors lie on known pixels, and where the map says the opposite of
/// them.
std::optional<DepthFit> anchored_fit(const ImageF& map, const ViewPlan& plan);

/// Turns a map of scale and shift into depth in world units; 0 where the fit gives none.
void make_metric(ImageF& map, DepthKind kind, const DepthFit& fit);

}  // namespace gs
