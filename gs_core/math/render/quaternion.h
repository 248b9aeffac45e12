// SPDX-License-Identifier: Apache-2.0
// From rotation matrices to quaternions (math/rotation.h has the opposite direction), and their
// product.
#pragma once

#include "gs_core/types.h"

namespace gs {

inline Quat<double> in_double(const Quatf& q) { return {q.w, q.x, q.y, q.z}; }

/// The rotation b followed by a.
template <class T>
GS_HD Quat<T> product(const Quat<T>& a, const Quat<T>& b) {
  return {
      a.w * b.w - a.x * b.x - a.y * b.y - a.z * b.z, a.w * b.x + a.x * b.w + a.y * b.z - a.z * b.y,
      a.w * b.y - a.x * b.z + a.y * b.w + a.z * b.x, a.w * b.z + a.x * b.y - a.y * b.x + a.z * b.w};
}

/// The quaternion of length 1 of a rotation matrix, computed from the products of its components by
/// way of the largest one.   Shepperd 1978
template <class T>
GS_HD Quat<T> quaternion_of(const Mat3<T>& R) {
  using std::sqrt;
  const T x = R.row0.x, y = R.row1.y, z = R.row2.z;
  const T ww = T(1) + x + y + z, xx = T(1) + x - y - z, yy = T(1) - x + y - z,
          zz = T(1) - x - y + z;
  const T wx = R.row2.y - R.row1.z, wy = R.row0.z - R.row2.x, wz = R.row1.x - R.row0.y;
  const T xy = R.row0.y + R.row1.x, xz = R.row0.z + R.row2.x, yz = R.row1.z + R.row2.y;
  const T largest = max_of(max_of(ww, xx), max_of(yy, zz));
  const Quat<T> q = largest == ww   ? Quat<T>{ww, wx, wy, wz}
                    : largest == xx ? Quat<T>{wx, xx, xy, xz}
                    : largest == yy ? Quat<T>{wy, xy, yy, yz}
                                    : Quat<T>{wz, xz, yz, zz};
  const T length = sqrt(squared_norm(q));
  return {q.w / length, q.x / length, q.y / length, q.z / length};
}

}  // namespace gs
