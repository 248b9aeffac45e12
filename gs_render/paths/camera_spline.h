// SPDX-License-Identifier: Apache-2.0
// A smooth path through given camera poses, for films.
#pragma once

#include <vector>

#include "gs_core/camera.h"

namespace gs {

/// Position and rotation of a camera, in double since paths are made of differences of poses.
struct CameraPose {
  Vec3d position{0.0, 0.0, 0.0};            // world units
  Quat<double> world_from_cam{1, 0, 0, 0};  // unit length
};

CameraPose pose_of(const Camera& camera);
/// The camera with another pose.
Camera with_pose(Camera camera, const CameraPose& pose);
/// The angle between two rotations in radians, 0 to pi.
double angle_between(const Quat<double>& a, const Quat<double>& b);

/// A curve through poses, once continuously differentiable in its time t.
///
/// Positions and quaternions are cubic between keys, with the slopes of a Catmull-Rom spline. From
/// key to key, t grows by the square root of their distance (centripetal; Yuksel, Schaefer and
/// Keyser 2011), so that the curve has no loops between near keys. Quaternions are brought to the
/// same hemisphere before they are interpolated, so that the camera turns the short way, and are
/// normalized afterwards. The distance of two poses includes their rotation: sqrt(d^2 +
/// (turn_length * angle)^2).
class CameraSpline {
 public:
  /// `keys` has at least one pose. A key that repeats the one before is skipped. A closed curve
  /// leads from the last key back to the first.
  CameraSpline(std::vector<CameraPose> keys, bool is_closed);

  /// The time of each key, from 0 on, and for a closed curve the time of its return to the first
  /// key.
  const std::vector<double>& knots() const { return knots_; }
  double end() const { return knots_.back(); }
  bool is_closed() const { return is_closed_; }
  double turn_length() const { return turn_length_; }  // world units per radian

  /// The pose at time t. Before 0 and after end() it is the pose at that end; a closed curve
  /// repeats.
  CameraPose at(double t) const;

 private:
  const CameraPose& key(std::ptrdiff_t i) const;
  double interval(std::ptrdiff_t i) const;  // from key i to key i + 1; 0 beyond the ends

  std::vector<CameraPose> keys_;
  std::vector<double> knots_;
  bool is_closed_;
  double turn_length_ = 1;
};

/// The speed along a curve: constant, or with the same time from each key to the next.
enum class Pace { even, by_keys };

/// `count` poses along the curve, the first at its start. The last pose is the last key of an open
/// curve, or one step before the start of a closed one, so that the film can be looped.
std::vector<CameraPose> poses_along(const CameraSpline& spline, std::size_t count, Pace pace);

}  // namespace gs
