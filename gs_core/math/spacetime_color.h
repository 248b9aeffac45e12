// SPDX-License-Identifier: Apache-2.0
// Stages 1, 7 and 9 for scenes that move: the color of a Gaussian in space and time may change during
// its life, in a straight line.   ours
//
//   sh0 at the time t = sh0 + sh0_slope u,   u = (t - mu_t) / sqrt(S_tt), phase() in spacetime.h
#pragma once

#include "gs_core/math/spacetime_splat.h"

namespace gs {

/// phase() of a Gaussian at a time; 0 for a static one, which has one color.
template <class T>
GS_HD T phase_at(const SpacetimeShape<T>& shape, const T& time) {
  if (is_static(shape)) return T(0);
  return phase(covariance(shape), time - shape.time_mean);
}
/// The coefficients of SH degree 0 at a time.
template <class T>
GS_HD Vec3<T> sh0_at(const Vec3<T>& sh0, const Vec3<T>& sh0_slope, const T& phase) {
  return sh0 + sh0_slope * phase;
}

/// project_gaussian() of spacetime_splat.h with a color that changes.
template <class T>
GS_HD ProjectedGaussian<T> project_gaussian(const PinholeCamera<T>& camera,
                                            const SpacetimeParameters<T>& gaussian,
                                            const Vec3<T>& sh0_slope, const T& time,
                                            const SplatSettings& settings) {
  SpacetimeParameters<T> now = gaussian;
  now.space.sh0 = sh0_at(gaussian.space.sh0, sh0_slope, phase_at(shape_of(gaussian), time));
  return project_gaussian(camera, now, time, settings);
}

/// dL/d(parameters) of a Gaussian whose color changes.
template <class T>
struct TimeColorGradient {
  SpacetimeGradient<T> without;  // those by all but sh0_slope
  Vec3<T> sh0_slope;
};
/// Gradients of project_gaussian() with a color that changes, for a Gaussian that was visible. Writes
/// the gradients of the SH coefficients in use into dL_dsh_rest. With c = dL/dsh0:
///
///   dL/dsh0_slope = u c,   dL/du = sh0_slope . c
template <class T>
GS_HD TimeColorGradient<T> project_gaussian_vjp(const PinholeCamera<T>& camera,
                                                const SpacetimeParameters<T>& gaussian,
                                                const Vec3<T>& sh0_slope, const T& time,
                                                const SplatSettings& settings,
                                                const BasicSplatGradient<T>& dL_dsplat,
                                                Vec3<T>* dL_dsh_rest) {
  const SpacetimeShape<T> shape = shape_of(gaussian);
  const ColorGradient<T> dL_color = color_splat_vjp(camera, mean_at(shape, time), gaussian.space,
                                                    settings, dL_dsplat.color, dL_dsh_rest);
  const T dL_dphase = inner(sh0_slope, dL_color.sh0);
  return {{project_shape_vjp(camera, shape, time, settings, dL_dsplat, dL_color.mean, dL_dphase),
           dL_color.sh0},
          dL_color.sh0 * phase_at(shape, time)};
}

/// A color that changes, with phases of another Gaussian.
struct TimeColor {
  Vec3f sh0, sh0_slope;
};
/// The color of `from`, at every time the same, in the phases of `to`. With means mu, mu' and
/// standard deviations s, s' in time:
///
///   sh0' = sh0 + sh0_slope (mu' - mu) / s,   sh0_slope' = sh0_slope s' / s
GS_HD TimeColor color_in_phases_of(const TimeColor& color, const SpacetimeShape<float>& from,
                                   const SpacetimeShape<float>& to) {
  using std::sqrt;
  if (is_static(from)) return color;
  const SpacetimeCovariance<float> S = covariance(from);
  const float scale = sqrt(covariance(to).time / S.time);
  return {sh0_at(color.sh0, color.sh0_slope, phase(S, to.time_mean - from.time_mean)),
          color.sh0_slope * scale};
}

}  // namespace gs
