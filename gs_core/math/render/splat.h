// SPDX-License-Identifier: Apache-2.0
// Stages 1 and 7: one Gaussian becomes a splat by a chain of activations, covariance, projection
// and color. The gradient of a splat is pulled back through the same chain to the stored
// parameters.
#pragma once

#include "gs_core/math/render/activations.h"
#include "gs_core/math/render/covariance.h"
#include "gs_core/math/render/filter_3d.h"
#include "gs_core/math/render/projection.h"
#include "gs_core/math/render/rotation.h"
#include "gs_core/math/render/sh.h"
#include "gs_core/math/render/tile_bounds.h"

namespace gs {

/// How a Gaussian becomes a splat.
struct SplatSettings {
  int sh_degree = 3;                          // degrees in use, 0..3
  Truncation truncation = Truncation::alpha;  // where a Gaussian ends
  TileBounds bounds = TileBounds::exact;      // which tiles list it
  bool antialias = false;                     // smaller dilation with opacity compensation
  bool antialias_detach = true;               // no gradient from the compensation to the covariance
  float near_plane = 0.2f, far_plane = 1e4f;  // world units, of depth_of()
  float blur = 0;  // pixels^2 added to the image covariance; 0: kBlur, or kBlurAntialias
};

/// The stored parameters of one Gaussian (gaussians.h).
template <class T>
struct GaussianParameters {
  Vec3<T> mean, log_scale;
  Quat<T> rotation;
  T logit_opacity;
  Vec3<T> sh0;
  const Vec3<T>* sh_rest;  // sh_rest_count(degree in use) coefficients
  T filter_scale{};        // standard deviation of its 3D filter, world units; 0: none
};

/// A Gaussian's footprint in one view: all that blending reads. Aligned for loads of 16 bytes.
template <class T>
struct alignas(alignof(T) > 16 ? alignof(T) : 16) BasicSplat {
  Vec2<T> mean2d;  // pixels
  Sym2<T> conic;   // inverse image-plane covariance, 1 / pixels^2
  T opacity;       // after the antialiasing factor
  T cutoff;        // a fragment is kept iff its exponent >= -cutoff
  Vec3<T> color;   // not clamped; blending takes max(color, 0)
  // image-plane covariance's yy, pixels^2: with it the conic is factored without cancellation
  T variance_y;
  T depth;  // what blending sums beside the color, where it is asked to: world units
};
using Splat = BasicSplat<float>;

/// dL/d(splat); the conic follows the convention of Sym2.
template <class T>
struct BasicSplatGradient {
  Vec2<T> mean2d;
  Sym2<T> conic;
  T opacity;
  Vec3<T> color;
  T depth{0};  // by ProjectedGaussian::depth, of photos with a depth map
};
using SplatGradient = BasicSplatGradient<float>;

/// What project_gaussian() makes of one Gaussian.
template <class T>
struct ProjectedGaussian {
  bool is_visible = false;  // false: everything else is undefined
  T depth;                  // world units, by depth_of()
  Sym2<T> cov2d;            // pixels^2, blur included
  BasicSplat<T> splat;
};

template <class T>
GS_HD T blur_of(const SplatSettings& settings) {
  if (settings.blur > 0) return T(settings.blur);
  return T(settings.antialias ? kBlurAntialias : kBlur);
}

template <class T>
GS_HD bool is_between_planes(const T& depth, const SplatSettings& settings) {
  return depth >= T(settings.near_plane) && depth <= T(settings.far_plane);
}

/// Projects the ellipsoid at p, in camera coordinates, with a world covariance and an opacity. Not
/// visible: beyond the lens, image covariance singular or beyond the scalar's range, opacity under the
/// truncation rule's threshold, or any value that is not finite.
template <class T>
GS_HD ProjectedGaussian<T> project_ellipsoid(const PinholeCamera<T>& camera, const Vec3<T>& p,
                                             const Sym3<T>& sigma, const T& opacity,
                                             const SplatSettings& settings) {
  ProjectedGaussian<T> result;
  if (is_beyond_lens(camera, p, sigma)) return result;
  result.depth = depth_of(camera, p);
  const T blur = blur_of<T>(settings);
  const ProjectedPoint<T> point = project_point(camera, p);
  result.cov2d = project_covariance(point.A, sigma, blur);
  const T det = determinant(result.cov2d);
  if (!(det >= T(kMinCovarianceDeterminant) && det < T(kMaxCovarianceDeterminant))) return result;

  BasicSplat<T>& splat = result.splat;
  splat.opacity = opacity;
  if (settings.antialias) splat.opacity *= antialias_factor(result.cov2d, blur);
  splat.cutoff = cutoff_of(settings.truncation, splat.opacity);
  if (!(splat.cutoff >= T(0))) return result;

  splat.mean2d = point.mean2d;
  splat.conic = conic_of(result.cov2d);
  splat.variance_y = result.cov2d.yy;
  splat.depth = result.depth;
  const T sum = splat.mean2d.x + splat.mean2d.y + splat.opacity;
  result.is_visible = sum - sum == T(0);  // false for NaN and infinity
  return result;
}

/// Projects one Gaussian into a view: everything but its color.
///                                       Kerbl et al. 2023, Sec. 4; Faster-GS, fused activations
///
/// filter_scale  standard deviation of its 3D filter (filter_3d.h)   world units; 0: none
///
/// Not visible: degenerate rotation, depth outside [near, far], or as project_ellipsoid() says.
template <class T>
GS_HD ProjectedGaussian<T> project_shape(const PinholeCamera<T>& camera, const Vec3<T>& mean,
                                         const Vec3<T>& log_scale, const Quat<T>& rotation,
                                         const T& logit_opacity, const T& filter_scale,
                                         const SplatSettings& settings) {
  const Vec3<T> p = to_camera(camera, mean);
  if (!is_between_planes(depth_of(camera, p), settings) || is_degenerate(rotation)) return {};
  const Vec3<T> variances = variance(log_scale);
  const Sym3<T> sigma =
      covariance(rotation_matrix(rotation), filtered_variance(variances, filter_scale));
  const T opacity = sigmoid(logit_opacity) * filter_factor(variances, filter_scale);
  return project_ellipsoid(camera, p, sigma, opacity, settings);
}

/// Gives a splat its color, that of the direction from the camera to `mean`. Not visible where it
/// is not finite.
///
/// mean  where the Gaussian is at the moment   world units
template <class T>
GS_HD void color_splat(ProjectedGaussian<T>& projected, const PinholeCamera<T>& camera,
                       const Vec3<T>& mean, const GaussianParameters<T>& gaussian,
                       const SplatSettings& settings) {
  if (!projected.is_visible) return;
  projected.splat.color = sh_color(settings.sh_degree, unit_direction(camera.position(), mean),
                                   gaussian.sh0, gaussian.sh_rest);
  projected.is_visible = is_finite(projected.splat.color);
}

/// Projects one Gaussian into a view: project_shape() and its color.
template <class T>
GS_HD ProjectedGaussian<T> project_gaussian(const PinholeCamera<T>& camera,
                                            const GaussianParameters<T>& gaussian,
                                            const SplatSettings& settings) {
  ProjectedGaussian<T> result =
      project_shape(camera, gaussian.mean, gaussian.log_scale, gaussian.rotation,
                    gaussian.logit_opacity, gaussian.filter_scale, settings);
  color_splat(result, camera, gaussian.mean, gaussian, settings);
  return result;
}

/// dL/d(parameters) of one Gaussian; the SH rest is written through a pointer.
template <class T>
struct GaussianGradient {
  Vec3<T> mean, log_scale;
  Quat<T> rotation;
  T logit_opacity;
  Vec3<T> sh0;
};
template <class T>
struct EllipsoidInCameraGradient {
  Vec3<T> p;  // in camera coordinates
  Mat23<T> A;
  Sym3<T> sigma;
  T opacity;
};
/// Gradients of project_ellipsoid(), for one that was visible, by p and by A = J W, before they are
/// pulled back to the world or to the camera.
template <class T>
GS_HD EllipsoidInCameraGradient<T> project_ellipsoid_in_camera_vjp(
    const PinholeCamera<T>& camera, const Vec3<T>& p, const Sym3<T>& sigma, const T& opacity,
    const SplatSettings& settings, const BasicSplatGradient<T>& dL_dsplat) {
  const Mat23<T> A = project_point(camera, p).A;
  const T blur = blur_of<T>(settings);
  const Sym2<T> cov2d = project_covariance(A, sigma, blur);

  EllipsoidInCameraGradient<T> gradient;
  // Opacity, and the antialiasing factor.
  Sym2<T> dL_dcov2d = conic_vjp(conic_of(cov2d), dL_dsplat.conic);
  gradient.opacity = dL_dsplat.opacity;
  if (settings.antialias) {
    if (!settings.antialias_detach) {
      const Sym2<T> dL = antialias_factor_vjp(cov2d, blur, dL_dsplat.opacity * opacity);
      dL_dcov2d = {dL_dcov2d.xx + dL.xx, dL_dcov2d.xy + dL.xy, dL_dcov2d.yy + dL.yy};
    }
    gradient.opacity *= antialias_factor(cov2d, blur);
  }
  // Covariance, and through the Jacobian the mean.
  const ProjectCovarianceGradient<T> dL_projection = project_covariance_vjp(A, sigma, dL_dcov2d);
  gradient.sigma = dL_projection.sigma;
  gradient.A = dL_projection.A;
  gradient.p = project_point_vjp(camera, p, dL_dsplat.mean2d, dL_projection.A);
  add_depth_vjp(camera, p, dL_dsplat.depth, gradient.p);
  return gradient;
}

template <class T>
struct EllipsoidGradient {
  Vec3<T> mean;  // in world coordinates
  Sym3<T> sigma;
  T opacity;
};
/// Gradients of project_ellipsoid(), for one that was visible.
template <class T>
GS_HD EllipsoidGradient<T> project_ellipsoid_vjp(const PinholeCamera<T>& camera, const Vec3<T>& p,
                                                 const Sym3<T>& sigma, const T& opacity,
                                                 const SplatSettings& settings,
                                                 const BasicSplatGradient<T>& dL_dsplat) {
  const EllipsoidInCameraGradient<T> dL =
      project_ellipsoid_in_camera_vjp(camera, p, sigma, opacity, settings, dL_dsplat);
  return {to_camera_vjp(camera, dL.p), dL.sigma, dL.opacity};
}

/// Gradients of project_shape(), for a Gaussian that was visible; sh0 and the color's part of the
/// mean are left out. The filter is a constant. Everything but the parameters is computed again.
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

template <class T>
struct ColorGradient {
  Vec3<T> mean, sh0;
};
/// Gradients of color_splat(): to the coefficients, and through the viewing direction to the mean.
/// Writes those of the SH coefficients in use into dL_dsh_rest.
template <class T>
GS_HD ColorGradient<T> color_splat_vjp(const PinholeCamera<T>& camera, const Vec3<T>& mean,
                                       const GaussianParameters<T>& gaussian,
                                       const SplatSettings& settings, const Vec3<T>& dL_dcolor,
                                       Vec3<T>* dL_dsh_rest) {
  const Vec3<T> eye = camera.position();
  const ShColorGradient<T> dL = sh_color_vjp(settings.sh_degree, unit_direction(eye, mean),
                                             gaussian.sh_rest, dL_dcolor, dL_dsh_rest);
  return {unit_direction_vjp(eye, mean, dL.direction), dL.sh0};
}

/// Gradients of project_gaussian(), for a Gaussian that was visible. Writes the gradients of the SH
/// coefficients in use into dL_dsh_rest.
template <class T>
GS_HD GaussianGradient<T> project_gaussian_vjp(const PinholeCamera<T>& camera,
                                               const GaussianParameters<T>& gaussian,
                                               const SplatSettings& settings,
                                               const BasicSplatGradient<T>& dL_dsplat,
                                               Vec3<T>* dL_dsh_rest) {
  GaussianGradient<T> gradient =
      project_shape_vjp(camera, gaussian.mean, gaussian.log_scale, gaussian.rotation,
                        gaussian.logit_opacity, gaussian.filter_scale, settings, dL_dsplat);
  const ColorGradient<T> dL_color =
      color_splat_vjp(camera, gaussian.mean, gaussian, settings, dL_dsplat.color, dL_dsh_rest);
  gradient.sh0 = dL_color.sh0;
  gradient.mean += dL_color.mean;
  return gradient;
}

}  // namespace gs
