// SPDX-License-Identifier: Apache-2.0
// Stage 1: rotation matrix of a quaternion of any length, and of an axis times an angle.
#pragma once

#include "gs_core/math/constants.h"
#include "gs_core/types.h"

namespace gs {

/// True if the quaternion is too short to define a rotation; such a Gaussian is never rendered.
template <class T>
GS_HD bool is_degenerate(const Quat<T>& q) {
  return !(squared_norm(q) >= T(kMinQuaternionNorm2));
}

/// Rotation matrix of q / |q|, by division by |q|^2 and without a square root:
///
///   R = I + 2/|q|^2 [ -yy-zz   xy-wz   xz+wy ]
///                   [  xy+wz  -xx-zz   yz-wx ]
///                   [  xz-wy   yz+wx  -xx-yy ]
template <class T>
GS_HD Mat3<T> rotation_matrix(const Quat<T>& q) {
  const T n = T(2) / squared_norm(q);
  const T xx = n * q.x * q.x, yy = n * q.y * q.y, zz = n * q.z * q.z;
  const T xy = n * q.x * q.y, xz = n * q.x * q.z, yz = n * q.y * q.z;
  const T wx = n * q.w * q.x, wy = n * q.w * q.y, wz = n * q.w * q.z;
  return {{T(1) - yy - zz, xy - wz, xz + wy},
          {xy + wz, T(1) - xx - zz, yz - wx},
          {xz - wy, yz + wx, T(1) - xx - yy}};
}
/// dL/dq of rotation_matrix(q); orthogonal to q, since the length of q has no effect.
template <class T>
GS_HD Quat<T> rotation_matrix_vjp(const Quat<T>& q, const Mat3<T>& dR) {
  const T n = T(2) / squared_norm(q);
  // dL by the products in the bracket above: d_xx stands for dL/d(xx), and so on.
  const T d_xx = -dR.row1.y - dR.row2.z, d_yy = -dR.row0.x - dR.row2.z,
          d_zz = -dR.row0.x - dR.row1.y;
  const T d_xy = dR.row0.y + dR.row1.x, d_xz = dR.row0.z + dR.row2.x, d_yz = dR.row1.z + dR.row2.y;
  const T d_wx = dR.row2.y - dR.row1.z, d_wy = dR.row0.z - dR.row2.x, d_wz = dR.row1.x - dR.row0.y;
  // Radial part: the change of 1/|q|^2.
  const T h = n * (q.x * q.x * d_xx + q.y * q.y * d_yy + q.z * q.z * d_zz + q.x * q.y * d_xy +
                   q.x * q.z * d_xz + q.y * q.z * d_yz + q.w * q.x * d_wx + q.w * q.y * d_wy +
                   q.w * q.z * d_wz);
  return {n * (q.x * d_wx + q.y * d_wy + q.z * d_wz - q.w * h),
          n * (T(2) * q.x * d_xx + q.y * d_xy + q.z * d_xz + q.w * d_wx - q.x * h),
          n * (T(2) * q.y * d_yy + q.x * d_xy + q.z * d_yz + q.w * d_wy - q.y * h),
          n * (T(2) * q.z * d_zz + q.x * d_xz + q.y * d_yz + q.w * d_wz - q.z * h)};
}

/// a [w] + b [w]^2, where [w] v = w x v.
template <class T>
GS_HD Mat3<T> cross_products(const Vec3<T>& w, const T& a, const T& b) {
  const T xx = w.x * w.x, yy = w.y * w.y, zz = w.z * w.z;
  return {{-b * (yy + zz), b * w.x * w.y - a * w.z, b * w.x * w.z + a * w.y},
          {b * w.x * w.y + a * w.z, -b * (xx + zz), b * w.y * w.z - a * w.x},
          {b * w.x * w.z - a * w.y, b * w.y * w.z + a * w.x, -b * (xx + yy)}};
}

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
  return cross_products(w, a, b);
}

/// The same of |w| up to 1 by its series, to 3e-7, for kernels that take it several times a Gaussian.
template <class T>
GS_HD Mat3<T> small_rotation_minus_identity(const Vec3<T>& w) {
  const T t2 = inner(w, w), one(1);
  const T a =
      one - t2 * T(1.0 / 6) *
                (one - t2 * T(1.0 / 20) * (one - t2 * T(1.0 / 42) * (one - t2 * T(1.0 / 72))));
  const T b =
      T(0.5) * (one - t2 * T(1.0 / 12) * (one - t2 * T(1.0 / 30) * (one - t2 * T(1.0 / 56))));
  return cross_products(w, a, b);
}

}  // namespace gs
