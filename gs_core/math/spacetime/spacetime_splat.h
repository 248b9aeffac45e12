// SPDX-License-Identifier: Apache-2.0
// Stages 1 and 7 for scenes that move: a Gaussian in space and time becomes a splat at one moment.
// It is conditioned on the time (spacetime.h); from there on it is an ellipsoid as any other
// (splat.h).
#pragma once

#include "gs_core/math/render/splat.h"
#include "gs_core/math/spacetime/spacetime.h"

namespace gs {

/// The stored parameters of a Gaussian in space and time.
template <class T>
struct SpacetimeParameters {
  GaussianParameters<T> space;  // its rotation is the left one of the pair
  Quat<T> right_rotation;
  T time_mean;       // in units of the scene's time
  T log_time_scale;  // log of the standard deviation along the fourth axis
};

/// Parameters of a Gaussian in space and time, without color. A gradient by the parameters has this
/// type, too.
template <class T>
struct SpacetimeShape {
  Vec3<T> mean, log_scale;
  QuatPair<T> rotations;
  T logit_opacity, time_mean, log_time_scale;
};
template <class T>
GS_HD SpacetimeShape<T> shape_of(const SpacetimeParameters<T>& gaussian) {
  const GaussianParameters<T>& space = gaussian.space;
  return {space.mean,          space.log_scale,    {space.rotation, gaussian.right_rotation},
          space.logit_opacity, gaussian.time_mean, gaussian.log_time_scale};
}

/// Whether a scale in time counts as the longest one, so that it has no gradient. Where a scene stands
/// still, nothing else would end the growth of this parameter, and covariances in time would exceed
/// the scalar's range.
template <class T>
GS_HD bool lives_longest(const T& log_time_scale) {
  return log_time_scale >= T(kMaxLogTimeScale);
}
/// The log of the scale in time that counts.
template <class T>
GS_HD T limited_log_time_scale(const T& log_time_scale) {
  return lives_longest(log_time_scale) ? T(kMaxLogTimeScale) : log_time_scale;
}

template <class T>
GS_HD Vec4<T> variance(const Vec3<T>& log_scale, const T& log_time_scale) {
  using std::exp;
  const Vec3<T> v = variance(log_scale);
  return {v.x, v.y, v.z, exp(T(2) * limited_log_time_scale(log_time_scale))};
}
template <class T>
GS_HD SpacetimeCovariance<T> covariance(const SpacetimeShape<T>& shape) {
  return covariance(rotation_matrix(shape.rotations),
                    variance(shape.log_scale, shape.log_time_scale));
}
/// Whether a Gaussian is far from its own time whatever its rotation, since S_tt is at most its
/// largest variance: a test by five numbers that no visible Gaussian passes.
template <class T>
GS_HD bool is_far_in_time(const Vec3<T>& log_scale, const T& time_mean, const T& log_time_scale,
                          const T& time) {
  using std::exp;
  constexpr double kReach2 =
      5.991464547107982;              // -2 ln kMinMarginal: (dt / sigma)^2 at that marginal
  constexpr double kRounding = 1.01;  // of the variances and the marginal, and more
  const T in_space = log_scale.x > log_scale.y ? log_scale.x : log_scale.y;
  const T in_time = limited_log_time_scale(log_time_scale);
  const T of_two = in_space > log_scale.z ? in_space : log_scale.z;
  const T largest = of_two > in_time ? of_two : in_time;
  const T elapsed = time - time_mean;
  return elapsed * elapsed > T(kReach2 * kRounding) * exp(T(2) * largest);
}

/// Where the mean of a Gaussian is at a time.   world units
template <class T>
GS_HD Vec3<T> mean_at(const SpacetimeShape<T>& shape, const T& time) {
  return shape.mean + velocity(covariance(shape)) * (time - shape.time_mean);
}

/// A Gaussian of space and time in a view, and its mean at the moment.
template <class T>
struct ProjectedMoment {
  ProjectedGaussian<T> projected;
  Vec3<T> mean = Vec3<T>(T(0));  // world units; undefined if it is not visible
};
/// Projects one Gaussian into a view at a time, without its color: exactly what project_ellipsoid()
/// makes of the Gaussian at that moment.
///
/// Not visible: a degenerate quaternion, a marginal below kMinMarginal, and as in 3D.
template <class T>
GS_HD ProjectedMoment<T> project_shape(const PinholeCamera<T>& camera,
                                       const SpacetimeShape<T>& shape, const T& time,
                                       const SplatSettings& settings) {
  if (is_degenerate(shape.rotations)) return {};
  const Instant<T> moment = condition(covariance(shape), time - shape.time_mean);
  if (!is_alive(moment.marginal)) return {};
  ProjectedMoment<T> result{};
  result.mean = shape.mean + moment.shift;
  const Vec3<T> p = to_camera(camera, result.mean);
  if (is_between_planes(depth_of(camera, p), settings))
    result.projected = project_ellipsoid(camera, p, moment.covariance,
                                         sigmoid(shape.logit_opacity) * moment.marginal, settings);
  return result;
}

/// project_shape() and the color, which is that of the direction to the mean at the moment.
template <class T>
GS_HD ProjectedGaussian<T> project_gaussian(const PinholeCamera<T>& camera,
                                            const SpacetimeParameters<T>& gaussian, const T& time,
                                            const SplatSettings& settings) {
  ProjectedMoment<T> moment = project_shape(camera, shape_of(gaussian), time, settings);
  color_splat(moment.projected, camera, moment.mean, gaussian.space, settings);
  return moment.projected;
}

/// Gradients of project_shape() by the parameters, for a Gaussian that was visible.
///
/// dL_dmean   what the color adds to dL/d(mean at the moment)
template <class T>
GS_HD SpacetimeShape<T> project_shape_vjp(const PinholeCamera<T>& camera,
                                          const SpacetimeShape<T>& shape, const T& time,
                                          const SplatSettings& settings,
                                          const BasicSplatGradient<T>& dL_dsplat,
                                          const Vec3<T>& dL_dmean) {
  const Mat4<T> R = rotation_matrix(shape.rotations);
  const Vec4<T> variances = variance(shape.log_scale, shape.log_time_scale);
  const SpacetimeCovariance<T> S = covariance(R, variances);
  const T elapsed = time - shape.time_mean;
  const Instant<T> moment = condition(S, elapsed);
  const T opacity = sigmoid(shape.logit_opacity);
  const EllipsoidGradient<T> dL =
      project_ellipsoid_vjp(camera, to_camera(camera, shape.mean + moment.shift), moment.covariance,
                            opacity * moment.marginal, settings, dL_dsplat);

  SpacetimeShape<T> gradient;
  gradient.mean = dL.mean + dL_dmean;
  gradient.logit_opacity = sigmoid_vjp(opacity, dL.opacity * moment.marginal);
  // The moment: to the covariance in 4D and the mean in time.
  const ConditionGradient<T> dL_condition =
      condition_vjp(S, elapsed, moment, Instant<T>{dL.sigma, gradient.mean, dL.opacity * opacity});
  gradient.time_mean = -dL_condition.elapsed;
  const SpacetimeCovarianceGradient<T> dL_covariance = covariance_vjp(R, variances, dL_condition.S);
  const Vec4<T> dL_dlog = T(2) * variances * dL_covariance.variance;
  gradient.log_scale = {dL_dlog.x, dL_dlog.y, dL_dlog.z};
  gradient.log_time_scale = lives_longest(shape.log_time_scale) ? T(0) : dL_dlog.w;
  gradient.rotations = rotation_matrix_vjp(shape.rotations, dL_covariance.R);
  return gradient;
}

/// dL/d(parameters) of a Gaussian in space and time; the SH rest is written through a pointer.
template <class T>
struct SpacetimeGradient {
  SpacetimeShape<T> shape;
  Vec3<T> sh0;
};
/// Gradients of project_gaussian() at a time, for a Gaussian that was visible then. Writes the
/// gradients of the SH coefficients in use into dL_dsh_rest.
template <class T>
GS_HD SpacetimeGradient<T> project_gaussian_vjp(const PinholeCamera<T>& camera,
                                                const SpacetimeParameters<T>& gaussian,
                                                const T& time, const SplatSettings& settings,
                                                const BasicSplatGradient<T>& dL_dsplat,
                                                Vec3<T>* dL_dsh_rest) {
  const SpacetimeShape<T> shape = shape_of(gaussian);
  const ColorGradient<T> dL_color = color_splat_vjp(camera, mean_at(shape, time), gaussian.space,
                                                    settings, dL_dsplat.color, dL_dsh_rest);
  return {project_shape_vjp(camera, shape, time, settings, dL_dsplat, dL_color.mean), dL_color.sh0};
}

}  // namespace gs
