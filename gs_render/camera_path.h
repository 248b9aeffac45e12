// SPDX-License-Identifier: Apache-2.0
// Camera paths for films: orbits around the center of a scene, and tours past its cameras.
#pragma once

#include <vector>

#include "gs_render/camera_spline.h"

namespace gs {

/// The common frame of a set of cameras: what they look at, and from where.
struct SceneFrame {
  Vec3d up{0.0, -1.0, 0.0};     // unit length
  Vec3d center{0.0, 0.0, 0.0};  // world units
  double radius = 1;            // world units: the median distance of a camera from the center
  double elevation = 0;         // degrees above the center, in the mean over cameras
};

/// Estimates the frame by least squares. `up` is perpendicular to the rows of the pictures, as far
/// as they agree, and near the mean of their columns. `center` is the point nearest to all optical
/// axes. Where the axes are parallel, it is `focus` world units in front of the cameras, in the
/// mean. `cameras` is not empty. Cameras far away from all others are ignored
/// (outlier_positions()).
SceneFrame scene_frame(const std::vector<Camera>& cameras, double focus);
/// The same for a known center.
SceneFrame scene_frame_about(const Vec3d& center, const std::vector<Camera>& cameras);

/// The rotation world_from_cam of a camera that looks from one point to another, with its columns
/// along `up`.
Quat<double> looking_at(const Vec3d& from, const Vec3d& to, const Vec3d& up);

struct Orbit {
  SceneFrame frame;
  double turns = 1;             // seen from above, counterclockwise; negative: clockwise
  Vec3d start{0.0, 0.0, 0.0};   // the first pose is on this point's side of the center
};

/// `count` poses on a circle around the axis through the center, all looking at the center. With
/// whole turns the film can be looped: the last pose is one step before the first. Otherwise the
/// last pose is at the end of `turns`.
std::vector<CameraPose> orbit(const Orbit& orbit, std::size_t count);

/// Ascending indices of at most `count` poses, each the middle of a group of near poses
/// (k-medoids). Outliers are never chosen. Not empty unless `poses` is. The distance between two
/// poses includes their rotation; one radian counts as much as the mean distance of the poses from
/// their centroid.
std::vector<std::size_t> representative_poses(const std::vector<CameraPose>& poses,
                                              std::size_t count);

/// A short closed tour through all poses, as indices in the order of the tour, from pose 0 on. It
/// starts as the nearest-neighbor tour and is improved by 2-opt exchanges (Croes 1958).
std::vector<std::size_t> short_tour(const std::vector<CameraPose>& poses);

}  // namespace gs
