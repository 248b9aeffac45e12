// SPDX-License-Identifier: Apache-2.0
// The photometric model "ppisp": exposure and a color homography of each photo. Photos are taken
// for pictures of one camera whose white and primaries move.
//                                                    PPISP (2026), without its response curve
#pragma once

#include <array>

#include "gs_core/types.h"

namespace gs {

/// The eight numbers of a photo's colors: two for each target, in the order blue, red, green,
/// white. All 0: the photo shows the scene's own colors.
template <class T>
using ColorLatents = std::array<T, 8>;

/// What latents turn into offsets (r, g) of a target, row by row: a whitening of the offsets that
/// cameras have.   PPISP (2026)
struct LatentScale {
  float m00, m01, m10, m11;
};
GS_HD LatentScale latent_scale(int target) {
  switch (target) {
    case 0: return {.0480542f, -.0043631f, -.0043631f, .0481283f};   // blue
    case 1: return {.0580570f, -.0179872f, -.0179872f, .0431061f};   // red
    case 2: return {.0433336f, -.0180537f, -.0180537f, .0580500f};   // green
    default: return {.0128369f, -.0034654f, -.0034654f, .0128158f};  // white
  }
}

/// What the latents of a photo do to a color x (rgb):
///
///   q = M (k o x),   y = f q,   f = (I + eps) / (J + eps),   I = sum x,   J = sum k o x
///
/// The columns of M are the primaries (r, g, 1 - r - g) of red, green and blue, and
/// k = 3 M^-1 (white). o multiplies by elements. f keeps the color's sum. A black pixel stays
/// black, because eps is in both sums; it is 1e-5.
template <class T>
struct ColorMatrix {
  Mat3<T> M;
  Vec3<T> k;
  Vec3<T> unlimited_k;  // k before it is kept from falling below kLeastColorGain
};
inline constexpr float kColorSumEpsilon = 1e-5f;
inline constexpr float kLeastColorGain = 0.1f;  // of k; farther away it has no gradient

namespace detail {

template <class T>
GS_HD Vec3<T> target(const ColorLatents<T>& latents, int index, T r, T g) {
  const LatentScale scale = latent_scale(index);
  const T a = latents[std::size_t(2 * index)], b = latents[std::size_t(2 * index + 1)];
  r += T(scale.m00) * a + T(scale.m01) * b;
  g += T(scale.m10) * a + T(scale.m11) * b;
  return {r, g, T(1) - r - g};
}

/// Adds the gradient of a target to that of its latents.
template <class T>
GS_HD void add_target_vjp(int index, const Vec3<T>& dL_dtarget, ColorLatents<T>& dL_dlatents) {
  const LatentScale scale = latent_scale(index);
  const T dr = dL_dtarget.x - dL_dtarget.z, dg = dL_dtarget.y - dL_dtarget.z;
  dL_dlatents[std::size_t(2 * index)] += T(scale.m00) * dr + T(scale.m10) * dg;
  dL_dlatents[std::size_t(2 * index + 1)] += T(scale.m01) * dr + T(scale.m11) * dg;
}

template <class T>
GS_HD Vec3<T> column(const Mat3<T>& m, int i) {
  return i == 0   ? Vec3<T>{m.row0.x, m.row1.x, m.row2.x}
         : i == 1 ? Vec3<T>{m.row0.y, m.row1.y, m.row2.y}
                  : Vec3<T>{m.row0.z, m.row1.z, m.row2.z};
}

/// The rows of the inverse of a matrix with these columns.
template <class T>
GS_HD Mat3<T> inverse_of_columns(const Vec3<T>& a, const Vec3<T>& b, const Vec3<T>& c) {
  const Vec3<T> bc = cross(b, c);
  const T scale = T(1) / inner(a, bc);
  return {scale * bc, scale * cross(c, a), scale * cross(a, b)};
}

}  // namespace detail

/// The matrix of a photo's latents, once for each photo.
template <class T>
GS_HD ColorMatrix<T> color_matrix(const ColorLatents<T>& latents) {
  const Vec3<T> blue = detail::target(latents, 0, T(0), T(0)),
                red = detail::target(latents, 1, T(1), T(0)),
                green = detail::target(latents, 2, T(0), T(1)),
                white = detail::target(latents, 3, T(1) / T(3), T(1) / T(3));
  ColorMatrix<T> matrix;
  matrix.M = {{red.x, green.x, blue.x}, {red.y, green.y, blue.y}, {red.z, green.z, blue.z}};
  const Vec3<T> k = T(3) * multiply(detail::inverse_of_columns(red, green, blue), white);
  const T least(kLeastColorGain);
  matrix.unlimited_k = k;
  matrix.k = {max_of(k.x, least), max_of(k.y, least), max_of(k.z, least)};
  return matrix;
}

/// What the photo shows of a color, before exposure and vignetting.
template <class T>
GS_HD Vec3<T> recolored(const ColorMatrix<T>& matrix, const Vec3<T>& x) {
  const Vec3<T> z = matrix.k * x;
  const T eps(kColorSumEpsilon);
  const T f = (x.x + x.y + x.z + eps) / (z.x + z.y + z.z + eps);
  return f * multiply(matrix.M, z);
}

/// Sums over the pixels of a photo, from which the gradient of its latents follows.
template <class T>
struct RecoloredSums {
  Mat3<T> M{};  // dL/dM
  Vec3<T> k{};  // dL/dk
};

/// dL/dx of recolored(), with `share` of the rest added to the sums.
template <class T>
GS_HD Vec3<T> recolored_vjp(const ColorMatrix<T>& matrix, const Vec3<T>& x, const Vec3<T>& dL_dy,
                            T share, RecoloredSums<T>& sums) {
  const Vec3<T> z = matrix.k * x, q = multiply(matrix.M, z);
  const T eps(kColorSumEpsilon);
  const T J = z.x + z.y + z.z + eps, f = (x.x + x.y + x.z + eps) / J;
  const T dL_df = inner(dL_dy, q);
  const Vec3<T> dL_dq = f * dL_dy;
  const T dL_dJ = -dL_df * f / J;
  const Vec3<T> dL_dz = multiply_transposed(matrix.M, dL_dq) + Vec3<T>(dL_dJ);
  sums.M.row0 += share * dL_dq.x * z;
  sums.M.row1 += share * dL_dq.y * z;
  sums.M.row2 += share * dL_dq.z * z;
  sums.k += share * (x * dL_dz);
  return matrix.k * dL_dz + Vec3<T>(dL_df / J);
}

/// dL/d(latents) from the sums over all pixels. k is that before its limit, and dL/dk is 0 where it
/// is below; h = M^-T dL/dk.
///
///   dL/d(white) = 3 h,   dL/dM = (sum over pixels) - h k^T
template <class T>
GS_HD ColorLatents<T> color_matrix_vjp(const ColorMatrix<T>& matrix, const RecoloredSums<T>& sums) {
  const Vec3<T> red = detail::column(matrix.M, 0), green = detail::column(matrix.M, 1),
                blue = detail::column(matrix.M, 2);
  const Vec3<T>& k = matrix.unlimited_k;
  const T least(kLeastColorGain);
  const Vec3<T> dL_dk{k.x > least ? sums.k.x : T(0), k.y > least ? sums.k.y : T(0),
                      k.z > least ? sums.k.z : T(0)};
  const Vec3<T> h = multiply_transposed(detail::inverse_of_columns(red, green, blue), dL_dk);
  ColorLatents<T> gradient{};
  detail::add_target_vjp(3, T(3) * h, gradient);
  detail::add_target_vjp(1, detail::column(sums.M, 0) - k.x * h, gradient);
  detail::add_target_vjp(2, detail::column(sums.M, 1) - k.y * h, gradient);
  detail::add_target_vjp(0, detail::column(sums.M, 2) - k.z * h, gradient);
  return gradient;
}

/// The latents of the white whose colors are multiplied by these gains, as near as the model can:
/// recolored() keeps the sum of a color.
template <class T>
GS_HD ColorLatents<T> latents_of_gains(const Vec3<T>& gains) {
  const T sum = gains.x + gains.y + gains.z, r = gains.x / sum - T(1) / T(3),
          g = gains.y / sum - T(1) / T(3);
  const LatentScale scale = latent_scale(3);
  const T m00(scale.m00), m01(scale.m01), m10(scale.m10), m11(scale.m11);
  const T determinant = m00 * m11 - m01 * m10;
  return {T(0),
          T(0),
          T(0),
          T(0),
          T(0),
          T(0),
          (m11 * r - m01 * g) / determinant,
          (m00 * g - m10 * r) / determinant};
}

}  // namespace gs
