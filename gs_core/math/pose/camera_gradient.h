// SPDX-License-Identifier: Apache-2.0
// Stage 7 for runs that refine poses: from the gradient of a splat to that of the camera.
#pragma once

#include "gs_core/gaussians.h"
#include "gs_core/math/pose/pose.h"
#include "gs_core/math/render/ellipsoid.h"
#include "gs_core/math/spacetime/spacetime_splat.h"

namespace gs {

/// The share of one visible Gaussian in the gradient by the camera. A camera that turns by d sees
/// the Gaussian turned by d about the camera: its mean, and its covariance S.
///
///   turn    = (mu - e) x dL/dmu + 2 (M_12 - M_21, M_20 - M_02, M_01 - M_10),   M = S dL/dS
///   center  = -dL/dmu - dL/dmu through the color's direction
///
/// mean, sigma, opacity   of the ellipsoid in the view, as for project_ellipsoid()
/// by_color               the color's part of dL/d(mean), as in ColorGradient
template <class T>
GS_HD CameraGradient<T> camera_vjp(const PinholeCamera<T>& camera, const Vec3<T>& mean,
                                   const Sym3<T>& sigma, const T& opacity,
                                   const SplatSettings& settings,
                                   const BasicSplatGradient<T>& dL_dsplat,
                                   const Vec3<T>& by_color) {
  const EllipsoidGradient<T> dL =
      project_ellipsoid_vjp(camera, to_camera(camera, mean), sigma, opacity, settings, dL_dsplat);
  const Sym3<T>& G = dL.sigma;
  const Vec3<T> g0{G.xx, G.xy, G.xz}, g1{G.xy, G.yy, G.yz}, g2{G.xz, G.yz, G.zz};
  const Vec3<T> m0 = multiply(sigma, g0), m1 = multiply(sigma, g1), m2 = multiply(sigma, g2);
  // m0, m1 and m2 are the columns of M.
  const Vec3<T> by_shape{m2.y - m1.z, m0.z - m2.x, m1.x - m0.y};
  return {cross(mean - camera.position(), dL.mean) + T(2) * by_shape, -dL.mean - by_color};
}

/// The ellipsoid of row i at a time, whatever arrays the Gaussians have. It is visible then.
GS_HD Ellipsoid ellipsoid_at(const GaussiansSpan& gaussians, std::size_t i, float time) {
  const Vec3f mean = gaussians.mean[i], log_scale = gaussians.log_scale[i];
  const Quatf rotation = gaussians.rotation[i];
  const float logit_opacity = gaussians.logit_opacity[i];
  if (!gaussians.has_time)
    return ellipsoid_of(mean, log_scale, rotation, logit_opacity,
                        gaussians.has_filter ? gaussians.filter_scale[i] : 0.0f);
  const SpacetimeShape<float> shape{mean,
                                    log_scale,
                                    {rotation, gaussians.right_rotation[i]},
                                    logit_opacity,
                                    gaussians.time_mean[i],
                                    gaussians.log_time_scale[i]};
  const Instant<float> moment = condition(covariance(shape), time - shape.time_mean);
  return {mean + moment.shift, moment.covariance, sigmoid(logit_opacity) * moment.marginal};
}

/// camera_vjp() of row i, which is visible, with its color.
GS_HD CameraGradient<float> camera_vjp(const GaussiansSpan& gaussians, std::size_t i,
                                       const Camera& camera, const SplatSettings& settings,
                                       const SplatGradient& dL_dsplat) {
  const Ellipsoid ellipsoid = ellipsoid_at(gaussians, i, camera.time);
  const Vec3f eye = camera.position(), direction = unit_direction(eye, ellipsoid.mean);
  float dL_dbasis[kShBasisCount];
  const Vec3f* const sh_rest = gaussians.sh_rest[i].coefficient;
  for (int k = 1; k < (settings.sh_degree + 1) * (settings.sh_degree + 1); ++k)
    dL_dbasis[k] = inner(sh_rest[k - 1], dL_dsplat.color);
  const Vec3f by_color = unit_direction_vjp(eye, ellipsoid.mean,
                                            sh_basis_vjp(settings.sh_degree, direction, dL_dbasis));
  return camera_vjp(camera, ellipsoid.mean, ellipsoid.sigma, ellipsoid.opacity, settings, dL_dsplat,
                    by_color);
}

}  // namespace gs
