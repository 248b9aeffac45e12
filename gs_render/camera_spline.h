// SPDX-License-Identifier: Apache-2.0
// A smooth way through given camera poses: what films are made along.
#pragma once

#include <vector>

#include "gs_core/camera.h"

namespace gs {

/// Where a camera stands and how it is turned; in double, for paths are differences of poses.
struct CameraPose {
  Vec3d position{0.0, 0.0, 0.0};            // world units
  Quat<double> world_from_cam{1, 0, 0, 0};  // unit length
};

CameraPose pose_of(const Camera& camera);
/// The camera with another pose.
Camera with_pose(Camera camera, const CameraPose& pose);
/// Between two attitudes, radians, 0 to pi.
double angle_between(const Quat<double>& a, const Quat<double>& b);

/// A curve through poses, once continuously differentiable in its time t.
///
/// Positions and quaternions are cubic between keys, with the slopes of a Catmull-Rom spline over knots that are not evenly
/// spaced: t grows from key to key by the square root of their distance (centripetal: Yuksel, Schaefer and Keyser 2011), so
/// that the curve has no loops between near keys. Quaternions are brought to one side before they are interpolated, so that
/// the camera takes the short way round, and are normalized after: at each key and between keys the rotation is one.
/// The distance of two poses counts their turn as well: sqrt(d^2 + (turn_length * angle)^2).
class CameraSpline {
 public:
  /// `keys` has at least one pose. A key that repeats the one before is left out. A closed curve goes on from the last key
  /// to the first.
  CameraSpline(std::vector<CameraPose> keys, bool is_closed);

  /// When each key is passed, from 0 on; of a closed curve also when the first is reached again.
  const std::vector<double>& knots() const { return knots_; }
  double end() const { return knots_.back(); }
  bool is_closed() const { return is_closed_; }
  double turn_length() const { return turn_length_; }  // world units per radian

  /// The pose at a time; before 0 and after end() that of the end, or on a closed curve that of the next round.
  CameraPose at(double t) const;

 private:
  const CameraPose& key(std::ptrdiff_t i) const;
  double interval(std::ptrdiff_t i) const;  // from key i to key i + 1; 0 beyond the ends

  std::vector<CameraPose> keys_;
  std::vector<double> knots_;
  bool is_closed_;
  double turn_length_ = 1;
};

/// How time goes along a curve: at one speed, or with the same time from each key to the next.
enum class Pace { even, by_keys };

/// `count` poses along the curve, the first at its start. An open one ends with its last key; of a closed one the last
/// pose stands one step before the first, so that a film of it has no break.
std::vector<CameraPose> poses_along(const CameraSpline& spline, std::size_t count, Pace pace);

}  // namespace gs
