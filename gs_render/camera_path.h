// SPDX-License-Identifier: Apache-2.0
// Ways of a camera that nobody has photographed: round what a scene's cameras look at, and past the cameras themselves.
#pragma once

#include <vector>

#include "gs_render/camera_spline.h"

namespace gs {

/// How a set of cameras stands round what it looks at.
struct SceneFrame {
  Vec3d up{0.0, -1.0, 0.0};     // unit length
  Vec3d center{0.0, 0.0, 0.0};  // world units
  double radius = 1;            // world units: the median distance of a camera from the center
  double elevation = 0;         // degrees: how high the cameras stand above the center, in the mean
};

/// Finds it. `up` is at right angles to the pictures' rows, as far as they agree, and near the mean of their columns;
/// `center` is the point that is nearest to all optical axes. Where these leave a direction open (parallel axes), it is
/// the one at `focus` world units before the cameras, in the mean. `cameras` is not empty; cameras far away from all others
/// do not count (outlier_positions).
SceneFrame scene_frame(const std::vector<Camera>& cameras, double focus);
/// The same about a center that is known.
SceneFrame scene_frame_about(const Vec3d& center, const std::vector<Camera>& cameras);

/// The attitude of a camera that looks from one point to another, its columns along `up`.
Quat<double> looking_at(const Vec3d& from, const Vec3d& to, const Vec3d& up);

struct Orbit {
  SceneFrame frame;
  double turns = 1;             // seen from above, counterclockwise; negative: clockwise
  Vec3d start{0.0, 0.0, 0.0};   // the first pose stands on this point's side of the center
};

/// `count` poses on a circle about the axis through the center, all looking at it. After whole turns the film goes on
/// where it began: the last pose stands one step before the first. Otherwise it ends after `turns`.
std::vector<CameraPose> orbit(const Orbit& orbit, std::size_t count);

/// At most `count` of the poses, each the middle one of a group of near poses; outlier ones are never taken. Ascending; not
/// empty unless `poses` is. Nearness counts turns, one radian as far as the poses' mean distance from their middle.
std::vector<std::size_t> representative_poses(const std::vector<CameraPose>& poses,
                                              std::size_t count);

/// A short closed tour through all poses: which comes after which, from pose 0 on. The nearest next one first, then
/// improved until no exchange of two of its legs makes it shorter (2-opt; Croes 1958).
std::vector<std::size_t> short_tour(const std::vector<CameraPose>& poses);

}  // namespace gs
