// SPDX-License-Identifier: Apache-2.0
// Small geometry that loaders, films and the viewer share: lengths of vectors, a 3x3 linear system,
// and whether a matrix is a rotation.
#pragma once

#include <array>
#include <cmath>

#include "gs_core/types.h"

namespace gs {

template <class T>
GS_HD T length(const Vec3<T>& v) {
  using std::sqrt;
  return sqrt(inner(v, v));
}
/// v / |v|; v is not 0.
template <class T>
GS_HD Vec3<T> unit(const Vec3<T>& v) {
  return v / length(v);
}

/// Two axes of unit length at right angles to `axis` (unit length) and to each other.
inline std::array<Vec3d, 2> axes_across(const Vec3d& axis) {
  const Vec3d x = unit(cross(axis, std::abs(axis.x) < 0.5 ? Vec3d(1, 0, 0) : Vec3d(0, 0, 1)));
  return {x, cross(axis, x)};
}

/// The x with S x = b, by Cramer's rule. S must be far from singular.
template <class T>
Vec3<T> solve(const Sym3<T>& S, const Vec3<T>& b) {
  const Vec3<T> row0{S.xx, S.xy, S.xz}, row1{S.xy, S.yy, S.yz}, row2{S.xz, S.yz, S.zz};
  const Vec3<T> c0 = cross(row1, row2), c1 = cross(row2, row0), c2 = cross(row0, row1);
  return (b.x * c0 + b.y * c1 + b.z * c2) / inner(row0, c0);
}

/// What keeps a matrix from being a rotation.
enum class RotationFault {
  none,
  scales,   // a row has not length 1
  shears,   // two rows are not at right angles
  mirrors,  // the rows are left-handed: the determinant is -1
};

/// The first fault of R in this order. Inner products of rows may be off by `tolerance`, which is
/// below 0.5. A matrix with NaN scales.
template <class T>
RotationFault rotation_fault(const Mat3<T>& R, T tolerance) {
  const auto near = [&](T a, T b) { return std::abs(a - b) < tolerance; };
  if (!near(inner(R.row0, R.row0), 1) || !near(inner(R.row1, R.row1), 1) ||
      !near(inner(R.row2, R.row2), 1))
    return RotationFault::scales;
  if (!near(inner(R.row0, R.row1), 0) || !near(inner(R.row0, R.row2), 0) ||
      !near(inner(R.row1, R.row2), 0))
    return RotationFault::shears;
  return inner(cross(R.row0, R.row1), R.row2) > 0 ? RotationFault::none : RotationFault::mirrors;
}

template <class T>
bool is_rotation(const Mat3<T>& R, T tolerance) {
  return rotation_fault(R, tolerance) == RotationFault::none;
}

}  // namespace gs
