// SPDX-License-Identifier: Apache-2.0
// Between stages 4 and 5: how a photo shows the scene's colors (photometric.model). The formulas of
// each model stand here, and gs_train/photometric/ has the table of models.
#pragma once

#include <array>

#include "gs_core/types.h"

namespace gs {

/// Where the pixels of a photo lie on its lens. rho is the squared distance from the principal
/// point, in half diagonals of the photo:
///
///   rho = 4 |p - (cx, cy)|^2 / (W^2 + H^2)      1 at the corners if the principal point is the middle
///
/// cx, cy      pixels; pixel (x, y) has its center p at (x + 0.5, y + 0.5)
/// per_pixel2  4 / (W^2 + H^2), 1 / pixels^2
struct LensPlace {
  float cx, cy, per_pixel2;

  GS_HD float rho(float x, float y) const {
    const float dx = x - cx, dy = y - cy;
    return (dx * dx + dy * dy) * per_pixel2;
  }
};

/// The place of a photo of `width` x `height` pixels that is reduced `factor` times: cx and cy are
/// those of the reduced photo. rho does not depend on the factor, also where pixels at the border
/// were left out (area_filter.h).
inline LensPlace lens_place(float cx, float cy, int width, int height, int factor) {
  const float side2 = float(width) * float(width) + float(height) * float(height);
  return {cx, cy, 4.0f * float(factor) * float(factor) / side2};
}

/// Legendre polynomials of s = 2 rho - 1, without the constant: s, (3 s^2 - 1) / 2, (5 s^3 - 3 s) / 2.
/// Their means over a disc of rho = 0 to 1, where each rho has the same area, are 0.
template <class T>
GS_HD std::array<T, 3> lens_polynomials(T rho) {
  const T s = T(2) * rho - T(1), s2 = s * s;
  return {s, (T(3) * s2 - T(1)) / T(2), s * (T(5) * s2 - T(3)) / T(2)};
}

/// Vignetting of a camera in log units.
///
///   B(rho) = b1 P1 + b2 P2 + b3 P3      P lens_polynomials(rho)
///
/// The polynomials are orthogonal to each other and to a constant: the mean brightness of a photo is
/// a matter of its gains alone, and no number has to wait for another one while they are learned.
template <class T>
GS_HD T log_vignetting(const std::array<T, 3>& b, T rho) {
  const std::array<T, 3> P = lens_polynomials(rho);
  return b[0] * P[0] + b[1] * P[1] + b[2] * P[2];
}

/// dB/db times dL/dB.
template <class T>
GS_HD std::array<T, 3> log_vignetting_vjp(T rho, T dL_dB) {
  const std::array<T, 3> P = lens_polynomials(rho);
  return {dL_dB * P[0], dL_dB * P[1], dL_dB * P[2]};
}

/// The model "gains", one channel of a pixel: a is the log gain of the photo, B the log vignetting
/// at the pixel. The photo shows
///
///   y = exp(a - B) x
template <class T>
GS_HD T gained(T x, T a, T B) {
  using std::exp;
  return exp(a - B) * x;
}

template <class T>
struct GainedGradient {
  T x, a, B;
};
/// `gain` is exp(a - B), `y` is gained(x, a, B).
///
///   dL/dx = gain G,   dL/da = G y,   dL/dB = -G y
template <class T>
GS_HD GainedGradient<T> gained_vjp(T y, T gain, T dL_dy) {
  const T dL_da = dL_dy * y;
  return {gain * dL_dy, dL_da, -dL_da};
}

/// A photo's log gain stays near the solved one, where there is one, by the loss
///
///   weight/2 ((a - solved) / spread)^2
///
/// Its gradient by a.
template <class T>
GS_HD T gain_prior_vjp(T a, T solved, T weight, T spread) {
  return weight * (a - solved) / (spread * spread);
}

/// A lens darkens towards its rim, so that a rim which is brighter than the middle costs
///
///   weight sum_k max(0, B(0) - B(rho_k))      rho_k = 1/4, 1/2, 1
template <class T>
GS_HD T bright_rim(const std::array<T, 3>& b, T weight) {
  T sum(0);
  for (const double rho : {0.25, 0.5, 1.0}) {
    const T darker = log_vignetting(b, T(rho)) - log_vignetting(b, T(0));
    if (darker < T(0)) sum -= weight * darker;
  }
  return sum;
}

/// Its gradient by b.
template <class T>
GS_HD std::array<T, 3> bright_rim_vjp(const std::array<T, 3>& b, T weight) {
  std::array<T, 3> sum{T(0), T(0), T(0)};
  const std::array<T, 3> middle = lens_polynomials(T(0));
  for (const double rho : {0.25, 0.5, 1.0}) {
    if (!(log_vignetting(b, T(rho)) < log_vignetting(b, T(0)))) continue;
    const std::array<T, 3> rim = lens_polynomials(T(rho));
    for (std::size_t i = 0; i < 3; ++i) sum[i] += weight * (middle[i] - rim[i]);
  }
  return sum;
}

}  // namespace gs
