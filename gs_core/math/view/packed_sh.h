// SPDX-License-Identifier: Apache-2.0
// SH coefficients in integers of 16 bits, for models that are drawn and not trained. A Gaussian has
// one scale for all of its coefficients beyond degree 0; that of degree 0, which is the largest,
// stays in float. The error of a coefficient is at most half a scale.
#pragma once

#include "gs_core/math/render/sh.h"

namespace gs {

inline constexpr float kMostPackedSh = 32767;

/// The scale of a Gaussian: its largest coefficient is kMostPackedSh of them. NaN if a coefficient
/// is not finite, so that its color is not finite, either.
///
/// numbers  `count` coefficients, those of all channels
GS_HD float packed_sh_scale(const float* numbers, int count) {
  float largest = 0, no_number = 0;
  for (int k = 0; k < count; ++k) {
    largest = max_of(largest, numbers[k] < 0 ? -numbers[k] : numbers[k]);
    no_number += numbers[k] - numbers[k];
  }
  return largest / kMostPackedSh + no_number;
}

/// A coefficient as a number of scales; 0 where the scale is 0 or NaN.
GS_HD std::int16_t packed_sh(float number, float scale) {
  using std::rint;
  if (!(scale > 0)) return 0;
  return std::int16_t(rint(clamp_to(number / scale, -kMostPackedSh, kMostPackedSh)));
}

/// sh_color() of packed coefficients.
///
/// sh0      coefficient of degree 0
/// sh_rest  coefficients of degrees 1.., three numbers each
GS_HD Vec3f packed_sh_color(int degree, const Vec3f& d, const Vec3f& sh0, float scale,
                            const std::int16_t* sh_rest) {
  float basis[kShBasisCount];
  sh_basis(degree, d, basis);
  Vec3f sum(0.0f);
  for (int k = 1; k < (degree + 1) * (degree + 1); ++k) {
    const std::int16_t* const c = sh_rest + 3 * (k - 1);
    sum += basis[k] * Vec3f(float(c[0]), float(c[1]), float(c[2]));
  }
  return Vec3f(float(kColorOffset)) + basis[0] * sh0 + scale * sum;
}

}  // namespace gs
