// SPDX-License-Identifier: Apache-2.0
// What the cameras of a scene see of its points. Where they see none, every step trains on an empty
// picture, and nothing is learned. The doctor and the training session ask here, so that they agree.
#pragma once

#include <string>
#include <vector>

#include "gs_core/buffer.h"
#include "gs_core/camera.h"

namespace gs {

/// The depths in which Gaussians are drawn (render.near_plane, render.far_plane); world units.
struct DepthLimits {
  float near_plane = 0.2f, far_plane = 1e4f;
};

/// Counts of views and points. "Ahead" means between the two planes; "in sight" also within the
/// picture, or just beside it.
struct SceneSight {
  std::size_t points = 0;
  std::size_t views = 0, views_with_points_ahead = 0, views_with_points_in_sight = 0;
  // The points as the views without a point in sight have them, over all these views.
  std::size_t behind = 0, too_near = 0, too_far = 0, beside = 0;
  double distance = 0;  // median depth of points in front of these views; world units, 0: none

  /// Whether not one Gaussian at these points would be drawn in any view. Such a run learns nothing.
  bool is_blind() const { return views > 0 && points > 0 && views_with_points_ahead == 0; }
  /// Whether most views see nothing. Points must be enough to tell; a run may still learn.
  bool is_doubtful() const;
};

/// Looks from all cameras at all points. Cameras that see something are done at the first point that
/// they see, so that this takes milliseconds for ordinary scenes.
SceneSight scene_sight(const std::vector<Camera>& cameras, Span<const Vec3f> points,
                       const DepthLimits& limits);

/// What is seen, why it is not more, and what to try. For a scene that is blind or doubtful.
std::string text_of(const SceneSight& sight, const DepthLimits& limits);

}  // namespace gs
