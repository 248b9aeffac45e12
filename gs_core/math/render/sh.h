// SPDX-License-Identifier: Apache-2.0
// Stage 1: view-dependent color by real spherical harmonics up to degree 3. The basis has the order
// and the signs of the reference trainer, so that files are interchangeable.
#pragma once

#include "gs_core/math/constants.h"
#include "gs_core/types.h"

namespace gs {

inline constexpr int kShBasisCount = 16;  // degrees 0..3

/// Unit vector from `from` to `to`. Undefined where they coincide.
template <class T>
GS_HD Vec3<T> unit_direction(const Vec3<T>& from, const Vec3<T>& to) {
  using std::sqrt;
  const Vec3<T> v = to - from;
  return v * (T(1) / sqrt(inner(v, v)));
}
/// dL/dto of unit_direction(): the part of the gradient across the direction, over the distance.
template <class T>
GS_HD Vec3<T> unit_direction_vjp(const Vec3<T>& from, const Vec3<T>& to,
                                 const Vec3<T>& dL_ddirection) {
  using std::sqrt;
  const Vec3<T> v = to - from;
  const T inverse = T(1) / sqrt(inner(v, v));
  const Vec3<T> d = v * inverse;
  return (dL_ddirection - d * inner(d, dL_ddirection)) * inverse;
}

/// Values of the basis functions of degrees 0..degree at the unit vector d; the others stay
/// untouched.
template <class T>
GS_HD void sh_basis(int degree, const Vec3<T>& d, T* basis) {
  basis[0] = T(kSh0);
  if (degree < 1) return;
  const T x = d.x, y = d.y, z = d.z;
  basis[1] = T(-kSh1) * y;
  basis[2] = T(kSh1) * z;
  basis[3] = T(-kSh1) * x;
  if (degree < 2) return;
  const T xx = x * x, yy = y * y, zz = z * z;
  basis[4] = T(kSh2a) * x * y;
  basis[5] = T(-kSh2a) * y * z;
  basis[6] = T(kSh2b) * zz - T(kSh2c);
  basis[7] = T(-kSh2a) * x * z;
  basis[8] = T(kSh2d) * (xx - yy);
  if (degree < 3) return;
  basis[9] = y * (T(kSh3a) * yy - T(kSh3b) * xx);
  basis[10] = T(kSh3c) * x * y * z;
  basis[11] = y * (T(kSh3d) - T(kSh3e) * zz);
  basis[12] = z * (T(kSh3f) * zz - T(kSh3g));
  basis[13] = x * (T(kSh3d) - T(kSh3e) * zz);
  basis[14] = T(kSh3h) * z * (xx - yy);
  basis[15] = x * (T(kSh3b) * yy - T(kSh3a) * xx);
}
/// dL/dd of sh_basis(), for the polynomials as they are written there.
template <class T>
GS_HD Vec3<T> sh_basis_vjp(int degree, const Vec3<T>& d, const T* g) {
  Vec3<T> dL{T(0), T(0), T(0)};
  if (degree < 1) return dL;
  const T x = d.x, y = d.y, z = d.z;
  dL.x += T(-kSh1) * g[3];
  dL.y += T(-kSh1) * g[1];
  dL.z += T(kSh1) * g[2];
  if (degree < 2) return dL;
  const T xx = x * x, yy = y * y, zz = z * z;
  dL.x += T(kSh2a) * (y * g[4] - z * g[7]) + T(2 * kSh2d) * x * g[8];
  dL.y += T(kSh2a) * (x * g[4] - z * g[5]) - T(2 * kSh2d) * y * g[8];
  dL.z += T(-kSh2a) * (y * g[5] + x * g[7]) + T(2 * kSh2b) * z * g[6];
  if (degree < 3) return dL;
  dL.x += T(-2 * kSh3b) * x * y * g[9] + T(kSh3c) * y * z * g[10] +
          (T(kSh3d) - T(kSh3e) * zz) * g[13] + T(2 * kSh3h) * x * z * g[14] +
          (T(kSh3b) * yy - T(3 * kSh3a) * xx) * g[15];
  dL.y += (T(3 * kSh3a) * yy - T(kSh3b) * xx) * g[9] + T(kSh3c) * x * z * g[10] +
          (T(kSh3d) - T(kSh3e) * zz) * g[11] - T(2 * kSh3h) * y * z * g[14] +
          T(2 * kSh3b) * x * y * g[15];
  dL.z += T(kSh3c) * x * y * g[10] - T(2 * kSh3e) * z * (y * g[11] + x * g[13]) +
          (T(3 * kSh3f) * zz - T(kSh3g)) * g[12] + T(kSh3h) * (xx - yy) * g[14];
  return dL;
}

/// Color seen along the unit vector d: 0.5 + sum_k basis_k c_k; not clamped.
///                                                                     Kerbl et al. 2023, Sec. 4
///
/// sh0      coefficient of degree 0
/// sh_rest  coefficients of degrees 1.., at least sh_rest_count(degree) of them
template <class T>
GS_HD Vec3<T> sh_color(int degree, const Vec3<T>& d, const Vec3<T>& sh0, const Vec3<T>* sh_rest) {
  T basis[kShBasisCount];
  sh_basis(degree, d, basis);
  Vec3<T> color = Vec3<T>(T(kColorOffset)) + basis[0] * sh0;
  for (int k = 1; k < (degree + 1) * (degree + 1); ++k) color += basis[k] * sh_rest[k - 1];
  return color;
}
template <class T>
struct ShColorGradient {
  Vec3<T> direction, sh0;
};
/// Gradients of sh_color(); writes those of the coefficients in use into dL_dsh_rest.
template <class T>
GS_HD ShColorGradient<T> sh_color_vjp(int degree, const Vec3<T>& d, const Vec3<T>* sh_rest,
                                      const Vec3<T>& dL_dcolor, Vec3<T>* dL_dsh_rest) {
  T basis[kShBasisCount], dL_dbasis[kShBasisCount];
  sh_basis(degree, d, basis);
  for (int k = 1; k < (degree + 1) * (degree + 1); ++k) {
    dL_dsh_rest[k - 1] = basis[k] * dL_dcolor;
    dL_dbasis[k] = inner(sh_rest[k - 1], dL_dcolor);
  }
  return {sh_basis_vjp(degree, d, dL_dbasis), basis[0] * dL_dcolor};
}

}  // namespace gs
