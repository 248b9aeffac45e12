// SPDX-License-Identifier: Apache-2.0
// Camera paths for films: orbits around the center of a scene, and tours past its cameras.
#pragma once

#include <vector>

#include "gs_core/geometry/scene_frame.h"
#include "gs_render/paths/camera_spline.h"

namespace gs {

/// The rotation world_from_cam of a camera that looks from one point to another, with its columns
/// along `up`.
Quat<double> looking_at(const Vec3d& from, const Vec3d& to, const Vec3d& up);

/// The part of the circle around a scene from which cameras look.
struct CameraArc {
  Vec3d middle{0.0, 0.0, 0.0};  // a point on the side of the center where its middle is
  double width = 0;             // radians; a whole turn where cameras stand all around
};

/// Cameras stand all around if the largest part of the circle without one is a quarter turn at most.
/// Outliers do not count.
CameraArc arc_of_cameras(const SceneFrame& frame, const std::vector<CameraPose>& poses);

struct Orbit {
  SceneFrame frame;
  double turns = 1;            // seen from above, counterclockwise; negative: clockwise
  Vec3d start{0.0, 0.0, 0.0};  // the first pose is on this point's side of the center
  double swing = 0;  // radians: not 0: to and fro over so much, with `start` in the middle
};

/// `count` poses on a circle around the axis through the center, all looking at the center. With
/// whole turns, or a swing, the film can be looped: the last pose is one step before the first.
/// Otherwise the last pose is at the end of `turns`.
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
