// SPDX-License-Identifier: Apache-2.0
// Stages 1 and 7 with the 3D filter (filter_3d.h): the chain of splat.h for a Gaussian that its
// filter widens.
#pragma once

#include "gs_core/math/filter_3d.h"
#include "gs_core/math/splat.h"

namespace gs {

/// project_shape() of splat.h for a Gaussian with a filter.
///
/// filter_scale  standard deviation of the filter   world units
template <class T>
GS_HD ProjectedGaussian<T> project_shape(const PinholeCamera<T>& camera, const Vec3<T>& mean,
                                         const Vec3<T>& log_scale, const Quat<T>& rotation,
                                         const T& logit_opacity, const T& filter_scale,
                                         const SplatSettings& settings) {
  const Vec3<T> p = to_camera(camera, mean);
  if (!is_between_planes(p.z, settings) || is_degenerate(rotation)) return {};
  const Vec3<T> variances = variance(log_scale);
  const Sym3<T> sigma =
      covariance(rotation_matrix(rotation), filtered_variance(variances, filter_scale));
  const T opacity = sigmoid(logit_opacity) * filter_factor(variances, filter_scale);
  return project_ellipsoid(camera, p, sigma, opacity, settings);
}

/// project_gaussian() of splat.h for a Gaussian with a filter.
template <class T>
GS_HD ProjectedGaussian<T> project_gaussian(const PinholeCamera<T>& camera,
                                            const GaussianParameters<T>& gaussian,
                                            const T& filter_scale, const SplatSettings& settings) {
  ProjectedGaussian<T> result =
      project_shape(camera, gaussian.mean, gaussian.log_scale, gaussian.rotation,
                    gaussian.logit_opacity, filter_scale, settings);
  color_splat(result, camera, gaussian.mean, gaussian, settings);
  return result;
}

/// Gradients of project_shape(), for a Gaussian that was visible; sh0 and the color's part of the
/// mean are left out. The filter is a constant.
template <class T>
GS_HD GaussianGradient<T> project_shape_vjp(const PinholeCamera<T>& camera, const Vec3<T>& mean,
                                            const Vec3<T>& log_scale, const Quat<T>& rotation,
                                            const T& logit_opacity, const T& filter_scale,
                                            const SplatSettings& settings,
                                            const BasicSplatGradient<T>& dL_dsplat) {
  const Mat3<T> R = rotation_matrix(rotation);
  const Vec3<T> variances = variance(log_scale);
  const Vec3<T> filtered = filtered_variance(variances, filter_scale);
  const T opacity = sigmoid(logit_opacity), factor = filter_factor(variances, filter_scale);
  const EllipsoidGradient<T> dL =
      project_ellipsoid_vjp(camera, to_camera(camera, mean), covariance(R, filtered),
                            opacity * factor, settings, dL_dsplat);

  GaussianGradient<T> gradient;
  gradient.sh0 = Vec3<T>(T(0));
  gradient.logit_opacity = sigmoid_vjp(opacity, dL.opacity * factor);
  const CovarianceGradient<T> dL_covariance = covariance_vjp(R, filtered, dL.sigma);
  gradient.log_scale = variance_vjp(variances, dL_covariance.variance) +
                       filter_factor_vjp(variances, filter_scale, factor, dL.opacity * opacity);
  gradient.rotation = rotation_matrix_vjp(rotation, dL_covariance.R);
  gradient.mean = dL.mean;
  return gradient;
}

/// Gradients of project_gaussian(), for a Gaussian that was visible. Writes the gradients of the SH
/// coefficients in use into dL_dsh_rest.
template <class T>
GS_HD GaussianGradient<T> project_gaussian_vjp(const PinholeCamera<T>& camera,
                                               const GaussianParameters<T>& gaussian,
                                               const T& filter_scale, const SplatSettings& settings,
                                               const BasicSplatGradient<T>& dL_dsplat,
                                               Vec3<T>* dL_dsh_rest) {
  GaussianGradient<T> gradient =
      project_shape_vjp(camera, gaussian.mean, gaussian.log_scale, gaussian.rotation,
                        gaussian.logit_opacity, filter_scale, settings, dL_dsplat);
  const ColorGradient<T> dL_color =
      color_splat_vjp(camera, gaussian.mean, gaussian, settings, dL_dsplat.color, dL_dsh_rest);
  gradient.sh0 = dL_color.sh0;
  gradient.mean += dL_color.mean;
  return gradient;
}

}  // namespace gs
