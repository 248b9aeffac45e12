// SPDX-License-Identifier: Apache-2.0
// Scale and shift of a photo's depth map, by the sparse points that the photo shows.
#pragma once

#include <optional>
#include <vector>

#include "data_loaders/colmap/colmap_model.h"
#include "data_loaders/scene/photo.h"
#include "gs_core/math/loss/depth_loss.h"

namespace gs {

/// Where a camera sees a point; nothing if it is behind the camera or outside its picture.
std::optional<DepthAnchor> anchor_of(const Camera& camera, const Vec3f& point);

/// Gives each photo with a map the points that it shows, where the view's camera sees them.
/// The model was read with Tracks::read; photos of models without tracks get none.
void add_depth_anchors(const ColmapModel& model, std::vector<Photo>& photos);

/// Whether a photo has enough anchors for scale and shift.
bool is_anchored(const Photo& photo);

/// Scale and shift of the map, which has the view's size: they minimize the sum of the absolute
/// errors of inverse depth at the anchors (math/depth_loss.h), so that some wrong points do no
/// harm. None where too few anchors lie on known pixels, and where the map says the opposite of
/// them.
std::optional<DepthFit> anchored_fit(const ImageF& map, const Photo& photo);

/// Turns a map of scale and shift into depth in world units; 0 where the fit gives none.
void make_metric(ImageF& map, DepthKind kind, const DepthFit& fit);

}  // namespace gs
