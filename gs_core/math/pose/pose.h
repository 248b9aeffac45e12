// SPDX-License-Identifier: Apache-2.0
// How a camera's pose is refined: a small motion of the camera, and its gradient.
// camera_gradient.h has the gradient of a picture by the camera.
#pragma once

#include "gs_core/camera.h"
#include "gs_core/math/constants.h"

namespace gs {

/// The rotation about the axis w by the angle |w|, minus the identity, so that nothing is rounded
/// off where it is small.   Rodrigues
///
///   exp([w]) - I = a [w] + b [w]^2,   a = sin(t) / t,   b = (1 - cos t) / t^2,   t = |w|
template <class T>
GS_HD Mat3<T> rotation_minus_identity(const Vec3<T>& w) {
  using std::cos;
  using std::sin;
  using std::sqrt;
  const T t2 = inner(w, w);
  T a = T(1) - t2 / T(6), b = T(0.5) - t2 / T(24);
  if (t2 > T(kSmallAngle2)) {
    const T t = sqrt(t2), half = sin(t / T(2));
    a = sin(t) / t;
    b = T(2) * half * half / t2;
  }
  const T xx = w.x * w.x, yy = w.y * w.y, zz = w.z * w.z;
  return {{-b * (yy + zz), b * w.x * w.y - a * w.z, b * w.x * w.z + a * w.y},
          {b * w.x * w.y + a * w.z, -b * (xx + zz), b * w.y * w.z - a * w.x},
          {b * w.x * w.z - a * w.y, b * w.y * w.z + a * w.x, -b * (xx + yy)}};
}
/// dL/dw, where e is dL by a further rotation: L(exp([d]) exp([w])) at d = 0 has the gradient e.
///
///   dL/dw = J^T e = e - b w x e + c w x (w x e),   c = (t - sin t) / t^3,   J = the left Jacobian
template <class T>
GS_HD Vec3<T> rotation_vector_vjp(const Vec3<T>& w, const Vec3<T>& e) {
  using std::sin;
  using std::sqrt;
  const T t2 = inner(w, w);
  T b = T(0.5) - t2 / T(24), c = T(1) / T(6) - t2 / T(120);
  if (t2 > T(kSmallAngle2)) {
    const T t = sqrt(t2), half = sin(t / T(2));
    b = T(2) * half * half / t2;
    c = (t - sin(t)) / (t2 * t);
  }
  const Vec3<T> once = cross(w, e);
  return e - b * once + c * cross(w, once);
}

/// What moves as one: a camera, or the cameras of a rig at one moment.
template <class T>
struct RigidFrame {
  Mat3<T> axes;   // rows: the directions of the frame's own axes in the world
  Vec3<T> pivot;  // that it turns about, world units
};
/// The camera after a small motion of its frame. With the axes B and the pivot c of the frame, and the
/// camera's rotation W and center e:
///
///   E = exp([turn]),   W' = W B^T E B,   e' = c + B^T E^T B (e - c) + B^T shift
///
/// A camera that is its own frame (B = W, c = e) turns about its center, so that turning does not
/// change the directions from which it sees the Gaussians.
template <class T>
GS_HD PinholeCamera<T> moved(const PinholeCamera<T>& camera, const RigidFrame<T>& frame,
                             const RigidMotion<T>& motion) {
  const Mat3<T> E = rotation_minus_identity(motion.turn);
  const Mat3<T>& B = frame.axes;
  const Vec3<T> center = camera.position();
  const Vec3<T> lever = multiply(B, center - frame.pivot);
  const Vec3<T> moved_center =
      center + multiply_transposed(B, multiply_transposed(E, lever) + motion.shift);
  // A row r of W becomes r + B^T E^T B r.
  const auto turned = [&](const Vec3<T>& row) {
    return row + multiply_transposed(B, multiply_transposed(E, multiply(B, row)));
  };
  PinholeCamera<T> result = camera;
  const Mat3<T>& W = camera.cam_from_world_rotation;
  result.cam_from_world_rotation = {turned(W.row0), turned(W.row1), turned(W.row2)};
  result.cam_from_world_translation = -multiply(result.cam_from_world_rotation, moved_center);
  return result;
}

/// dL by a further motion of a camera, in the axes of the world. `turn` is that of
/// L(W exp([d])) at d = 0 with the center where it is, and `center` is dL by the center.
template <class T>
struct CameraGradient {
  Vec3<T> turn, center;
};
/// dL/d(motion) of moved().
template <class T>
GS_HD RigidMotion<T> moved_vjp(const PinholeCamera<T>& camera, const RigidFrame<T>& frame,
                               const RigidMotion<T>& motion, const CameraGradient<T>& dL) {
  const Mat3<T> E = rotation_minus_identity(motion.turn);
  const Mat3<T>& B = frame.axes;
  const auto turned = [&](const Vec3<T>& in_world) {  // E B v
    const Vec3<T> v = multiply(B, in_world);
    return v + multiply(E, v);
  };
  const Vec3<T> lever = multiply(B, camera.position() - frame.pivot);
  const Vec3<T> dL_dfurther = turned(dL.turn) - cross(lever, turned(dL.center));
  return {rotation_vector_vjp(motion.turn, dL_dfurther), multiply(B, dL.center)};
}

}  // namespace gs
