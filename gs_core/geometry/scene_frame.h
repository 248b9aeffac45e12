// SPDX-License-Identifier: Apache-2.0
// Which way is up in a scene and what its cameras look at. Films, the viewer and the doctor ask
// here, so that they agree.
#pragma once

#include <vector>

#include "gs_core/buffer.h"
#include "gs_core/camera.h"

namespace gs {

/// How a set of cameras stands around what it looks at.
struct SceneFrame {
  Vec3d up{0.0, -1.0, 0.0};     // unit length; without cameras -y, as COLMAP's axes have it
  Vec3d center{0.0, 0.0, 0.0};  // world units
  double radius = 1;            // world units: the median distance of a camera from the center
  double elevation = 0;         // degrees: how high the cameras stand above the center, on average
  double up_spread = 0;         // degrees: between `up` and the cameras' own up, on average
  bool up_is_known = false;     // whether the cameras agree about `up`; else it is a guess
};

/// The frame of a scene.
///
///   up      is at right angles to the rows of the images, as far as they agree, and near the mean
///           of their columns
///   center  is the point nearest to all optical axes; where these leave it open (parallel axes),
///           the one nearest to the median of the points
///
/// `up` is known if the cameras' own ups lie near it, as of photos taken level, or if the rows of the
/// images leave no other direction open, as of a drone's photos. Photos that lie on their side or
/// were held in all directions leave it unknown.
///
/// Cameras far away from all others (outlier_positions) do not count. Without cameras, center and
/// radius are those of the points: their median, and the distance from it that nine in ten keep. Of
/// many points some 100,000 are looked at, evenly chosen; points that are not finite are left out.
/// Both may be empty.
SceneFrame scene_frame(const std::vector<Camera>& cameras, Span<const Vec3f> points);

/// A frame about a center that is known. `cameras` is not empty.
SceneFrame scene_frame_about(const Vec3d& center, const std::vector<Camera>& cameras);

}  // namespace gs
