// SPDX-License-Identifier: Apache-2.0
// Stages 1 and 7 for scenes that move: a Gaussian in space and time becomes a splat at one moment.
// It is conditioned on the time (spacetime.h); from there on it is an ellipsoid as any other
// (splat.h).
#pragma once

#include "gs_core/math/spacetime.h"
#include "gs_core/math/splat.h"

namespace gs {

/// The stored parameters of a Gaussian in space and time.
template <class T>
struct SpacetimeParameters {
  GaussianParameters<T> space;  // its rotation is the left one of the pair
  Quat<T> right_rotation;
  T time_mean;       // in units of the scene's time
  T log_time_scale;  // log of the standard deviation along the fourth axis
};

template <class T>
GS_HD QuatPair<T> rotations_of(const SpacetimeParameters<T>& gaussian) {
  return {gaussian.space.rotation, gaussian.right_rotation};
}
template <class T>
GS_HD Vec4<T> variance(const Vec3<T>& log_scale, const T& log_time_scale) {
  using std::exp;
  const Vec3<T> v = variance(log_scale);
  return {v.x, v.y, v.z, exp(T(2) * log_time_scale)};
}

/// Projects one Gaussian into a view at a time: exactly what project_ellipsoid() makes of the
/// Gaussian at that moment. The color is that of the direction to its mean at that moment.
///
/// Not visible: a degenerate quaternion, a marginal below kMinMarginal, and as in 3D.
template <class T>
GS_HD ProjectedGaussian<T> project_gaussian(const PinholeCamera<T>& camera,
                                            const SpacetimeParameters<T>& gaussian, const T& time,
                                            const SplatSettings& settings) {
  const GaussianParameters<T>& space = gaussian.space;
  if (is_degenerate(space.rotation) || is_degenerate(gaussian.right_rotation)) return {};
  const SpacetimeCovariance<T> S = covariance(rotation_matrix(rotations_of(gaussian)),
                                              variance(space.log_scale, gaussian.log_time_scale));
  const Moment<T> moment = condition(S, time - gaussian.time_mean);
  if (!is_alive(moment.marginal)) return {};
  const Vec3<T> mean = space.mean + moment.shift;
  const Vec3<T> p = to_camera(camera, mean);
  if (!is_between_planes(p.z, settings)) return {};
  ProjectedGaussian<T> result = project_ellipsoid(
      camera, p, moment.covariance, sigmoid(space.logit_opacity) * moment.marginal, settings);
  if (!result.is_visible) return result;
  result.splat.color = sh_color(settings.sh_degree, unit_direction(camera.position(), mean),
                                space.sh0, space.sh_rest);
  result.is_visible = is_finite(result.splat.color);
  return result;
}

/// dL/d(parameters) of a Gaussian in space and time; the SH rest is written through a pointer.
template <class T>
struct SpacetimeGradient {
  GaussianGradient<T> space;
  Quat<T> right_rotation;
  T time_mean, log_time_scale;
};
/// Gradients of project_gaussian() at a time, for a Gaussian that was visible then. Writes the
/// gradients of the SH coefficients in use into dL_dsh_rest.
template <class T>
GS_HD SpacetimeGradient<T> project_gaussian_vjp(const PinholeCamera<T>& camera,
                                                const SpacetimeParameters<T>& gaussian,
                                                const T& time, const SplatSettings& settings,
                                                const BasicSplatGradient<T>& dL_dsplat,
                                                Vec3<T>* dL_dsh_rest) {
  const GaussianParameters<T>& space = gaussian.space;
  const QuatPair<T> rotations = rotations_of(gaussian);
  const Mat4<T> R = rotation_matrix(rotations);
  const Vec4<T> variances = variance(space.log_scale, gaussian.log_time_scale);
  const SpacetimeCovariance<T> S = covariance(R, variances);
  const T elapsed = time - gaussian.time_mean;
  const Moment<T> moment = condition(S, elapsed);
  const Vec3<T> mean = space.mean + moment.shift;
  const T opacity = sigmoid(space.logit_opacity);

  EllipsoidGradient<T> dL =
      project_ellipsoid_vjp(camera, to_camera(camera, mean), moment.covariance,
                            opacity * moment.marginal, settings, dL_dsplat);
  SpacetimeGradient<T> gradient;
  // Color: to the coefficients, and through the viewing direction to the mean at the moment.
  const Vec3<T> eye = camera.position();
  const ShColorGradient<T> dL_color = sh_color_vjp(settings.sh_degree, unit_direction(eye, mean),
                                                   space.sh_rest, dL_dsplat.color, dL_dsh_rest);
  gradient.space.sh0 = dL_color.sh0;
  dL.mean += unit_direction_vjp(eye, mean, dL_color.direction);
  gradient.space.mean = dL.mean;
  gradient.space.logit_opacity = sigmoid_vjp(opacity, dL.opacity * moment.marginal);

  // The moment: to the covariance in 4D and the mean in time.
  const ConditionGradient<T> dL_condition =
      condition_vjp(S, elapsed, moment, Moment<T>{dL.sigma, dL.mean, dL.opacity * opacity});
  gradient.time_mean = -dL_condition.elapsed;
  const SpacetimeCovarianceGradient<T> dL_covariance = covariance_vjp(R, variances, dL_condition.S);
  const Vec4<T> dL_dlog = T(2) * variances * dL_covariance.variance;
  gradient.space.log_scale = {dL_dlog.x, dL_dlog.y, dL_dlog.z};
  gradient.log_time_scale = dL_dlog.w;
  const QuatPair<T> dL_rotations = rotation_matrix_vjp(rotations, dL_covariance.R);
  gradient.space.rotation = dL_rotations.left;
  gradient.right_rotation = dL_rotations.right;
  return gradient;
}

}  // namespace gs
