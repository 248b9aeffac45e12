// SPDX-License-Identifier: Apache-2.0
// Stages 1 and 7 of cameras that move while the rows of their picture are exposed one after the
// other, from the top down. Each point is seen at the time of its own row, and its splat is as wide
// as the motion makes it.   docs/method/lenses.md#rolling-shutters
#pragma once

#include "gs_core/math/lens/lens_projection.h"
#include "gs_core/math/render/rotation.h"

namespace gs {

inline constexpr double kMostShutterTurn = 1;     // radians, of RigidMotion::turn
inline constexpr int kShutterSteps = 4;           // of Newton's method: 1e-5 is squared by each
inline constexpr double kLeastShutterLead = 0.1;  // of rows over a point, in their own speed

/// A point of such a camera when its row is exposed. With p in the coordinates of the camera at mid
/// time, and a motion of turn w and shift d:
///
///   at tau:   q = R x,   R = exp([tau w]),   x = p - tau d          tau = -1/2 ... 1/2
///   tau = row / height - 1/2,   row = pi(q).y                       its row is exposed then
///
/// where height is that of CameraLens::rows, from the first of which rows count. For points above or
/// below them by kFrustumMargin of it and more, and beyond the lens, the camera stands still at tau.
template <class T>
struct ExposedPoint {
  Vec3<T> x;
  PinholeCamera<T> turned;  // its rotation is R
  Vec3<T> q;                // world units, camera coordinates at tau
  ProjectedPoint<T> seen;   // A = dpi/dq R, by x
  Vec3<T> v;                // dx/dtau seen by the turning camera: w x x - d
  Vec2<T> speed;            // A v, of the mean by tau   pixels
  T per_row;                // 1 / height
  T lag;                    // 1 / (1 - speed.y / height); infinite: the point is not seen
  bool moves;               // with tau; else speed is 0
};
template <class T>
GS_HD ExposedPoint<T> exposed_point(const PinholeCamera<T>& camera, const Vec3<T>& p) {
  const RigidMotion<T>& motion = camera.lens.motion;
  const Vec2<T>& rows = camera.lens.rows;
  const T first_row = camera.cy + camera.fy * rows.x, most = T(0.5 + kFrustumMargin);
  ExposedPoint<T> point;
  point.per_row = T(1) / (camera.fy * (rows.y - rows.x));
  point.turned = camera;
  bool is_due = true;
  T tau(0);
  for (int step = 0;; ++step) {
    const Mat3<T> E = small_rotation_minus_identity(tau * motion.turn);
    point.x = p - tau * motion.shift;
    point.q = point.x + multiply(E, point.x);
    point.turned.cam_from_world_rotation = {Vec3<T>(T(1), T(0), T(0)) + E.row0,
                                            Vec3<T>(T(0), T(1), T(0)) + E.row1,
                                            Vec3<T>(T(0), T(0), T(1)) + E.row2};
    point.seen = project_through_lens(point.turned, point.q);
    point.v = cross(motion.turn, point.x) - motion.shift;
    point.speed = {inner(point.seen.A.row0, point.v), inner(point.seen.A.row1, point.v)};
    const T lead = T(1) - point.speed.y * point.per_row;
    const bool is_passed = lead > T(kLeastShutterLead);
    point.lag = T(1) / (is_passed ? lead : T(kLeastShutterLead));
    if (step == kShutterSteps) {
      const PointInLens<T> at = point_in_lens(camera.lens, chart_of(camera.lens.lens, point.q));
      const bool is_inside = at.inside == at.u;
      const bool is_before = has_angle_chart(camera.lens.lens) || point.q.z > T(0);
      point.moves = is_due && is_inside;
      if (!point.moves) point.speed = {T(0), T(0)}, point.lag = T(1);
      if (!is_before || (is_inside && !is_passed))
        point.lag = T(std::numeric_limits<double>::infinity());
      return point;
    }
    const T due = (point.seen.mean2d.y - first_row) * point.per_row - T(0.5);
    const T next = tau + (due - tau) * point.lag;
    tau = clamp_to(next, -most, most);
    is_due = tau == next;
  }
}

/// The projection of p, which mean2d and its derivative follow through tau:
///
///   A' = (I + speed e^T lag) A W,   e = (0, 1 / height)
template <class T>
GS_HD ProjectedPoint<T> project_through_shutter(const PinholeCamera<T>& camera, const Vec3<T>& p) {
  const ExposedPoint<T> point = exposed_point(camera, p);
  const Mat23<T>& A = point.seen.A;
  const Mat3<T>& W = camera.cam_from_world_rotation;
  const T shear = point.speed.x * point.lag * point.per_row;
  return {point.seen.mean2d,
          {multiply_transposed(W, A.row0 + shear * A.row1),
           multiply_transposed(W, point.lag * A.row1)}};
}
/// dL/dp of project_through_shutter(), through tau and speed, too. Beyond the lens tau is constant.
template <class T>
GS_HD Vec3<T> project_through_shutter_vjp(const PinholeCamera<T>& camera, const Vec3<T>& p,
                                          const Vec2<T>& dL_dmean2d, const Mat23<T>& dL_dA) {
  const ExposedPoint<T> point = exposed_point(camera, p);
  const RigidMotion<T>& motion = camera.lens.motion;
  const Mat23<T>& A = point.seen.A;
  const Vec3<T>& v = point.v;
  const T e_lag = point.lag * point.per_row, shear = point.speed.x * e_lag;
  const Mat3<T>& W = camera.cam_from_world_rotation;
  const Vec3<T> G0 = multiply(W, dL_dA.row0), G1 = multiply(W, dL_dA.row1);
  if (!point.moves)
    return multiply_transposed(
        point.turned.cam_from_world_rotation,
        project_through_lens_vjp(point.turned, point.q, dL_dmean2d, Mat23<T>{G0, G1}));
  // A and speed = A v, of which the shear and the lag are made.
  const T along = inner(G0, A.row1);
  const Vec2<T> dL_dspeed{e_lag * along, e_lag * (shear * along + point.lag * inner(G1, A.row1))};
  const Mat23<T> dL{G0 + dL_dspeed.x * v, shear * G0 + point.lag * G1 + dL_dspeed.y * v};
  const Vec3<T> dL_dv = dL_dspeed.x * A.row0 + dL_dspeed.y * A.row1;
  const Vec3<T> by_q =
      multiply_transposed(point.turned.cam_from_world_rotation,
                          project_through_lens_vjp(point.turned, point.q, dL_dmean2d, dL));
  const Vec3<T> dL_dx = by_q + cross(dL_dv, motion.turn);
  // tau: it moves x, turns q and A, and follows p by e^T A'.
  const T dL_dtau = inner(by_q, v) - inner(cross(dL_dv, motion.turn), motion.shift) +
                    inner(dL.row0, cross(A.row0, motion.turn)) +
                    inner(dL.row1, cross(A.row1, motion.turn));
  return dL_dx + dL_dtau * e_lag * A.row1;
}

}  // namespace gs
