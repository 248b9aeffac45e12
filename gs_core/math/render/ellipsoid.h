// SPDX-License-Identifier: Apache-2.0
// What every view of a Gaussian begins with: its mean, covariance and opacity. A model that is
// drawn many times without changing keeps these in place of scales, rotation and logit.
#pragma once

#include <limits>

#include "gs_core/math/render/splat.h"

namespace gs {

/// A Gaussian without its color. 40 bytes.
struct Ellipsoid {
  Vec3f mean;         // world units; NaN: it is never drawn
  Sym3<float> sigma;  // covariance, world units^2
  float opacity;      // 0..1
};
static_assert(sizeof(Ellipsoid) == 40);

inline constexpr Ellipsoid kNoEllipsoid = {
    {std::numeric_limits<float>::quiet_NaN(), 0, 0}, {0, 0, 0, 0, 0, 0}, 0};

/// The ellipsoid of stored parameters (gaussians.h). project_shape() makes the same numbers, so
/// that it and project_ellipsoid() of the result agree to the last bit.
///
/// filter_scale  standard deviation of its 3D filter (filter_3d.h)   world units; 0: none
GS_HD Ellipsoid ellipsoid_of(const Vec3f& mean, const Vec3f& log_scale, const Quatf& rotation,
                             float logit_opacity, float filter_scale) {
  if (is_degenerate(rotation)) return kNoEllipsoid;
  const Vec3f variances = variance(log_scale);
  return {mean, covariance(rotation_matrix(rotation), filtered_variance(variances, filter_scale)),
          sigmoid(logit_opacity) * filter_factor(variances, filter_scale)};
}

/// Projects an ellipsoid into a view, as project_shape() of splat.h does.
GS_HD ProjectedGaussian<float> project_shape(const PinholeCamera<float>& camera,
                                             const Ellipsoid& ellipsoid,
                                             const SplatSettings& settings) {
  const Vec3f p = to_camera(camera, ellipsoid.mean);
  if (!is_between_planes(depth_of(camera, p), settings)) return {};
  return project_ellipsoid(camera, p, ellipsoid.sigma, ellipsoid.opacity, settings);
}

}  // namespace gs
