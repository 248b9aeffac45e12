// SPDX-License-Identifier: Apache-2.0
// The surface of a splat: where a ray through a pixel meets its Gaussian.
#pragma once

#include "gs_core/math/render/covariance.h"
#include "gs_core/math/render/filter_3d.h"
#include "gs_core/math/render/projection.h"
#include "gs_core/math/render/rotation.h"
#include "gs_core/math/render/splat.h"

namespace gs {

/// The plane of a splat in the picture: its inverse depth is affine in the pixel.
///
///   1/z (pixel) = at_mean + slope . (pixel - mean2d)
template <class T>
struct SplatPlane {
  T at_mean;      // 1 / world units
  Vec2<T> slope;  // 1 / (world units * pixels)

  /// The inverse depth at an offset from the mean, pixels.
  GS_HD T at(const Vec2<T>& d) const { return at_mean + inner(slope, d); }
};

/// The plane on which rays meet the most of a Gaussian. For a flat Gaussian it is the plane in
/// which that lies, exactly; for a ball it is nearly parallel to the picture.
///
///   s = A Sigma w,   g = Q s = dz/d(pixel),   at_mean = 1/z,   slope = -g/z^2
///
/// where w is the viewing axis in world space: z and pixel are jointly normal to first order, and g
/// is the regression of the one on the other.
///
/// p      the Gaussian's mean in camera coordinates, p.z > 0   world units
/// sigma  its world covariance                                 world units^2
/// conic  of its splat                                         1 / pixels^2
template <class T>
GS_HD SplatPlane<T> splat_plane(const PinholeCamera<T>& camera, const Vec3<T>& p,
                                const Sym3<T>& sigma, const Sym2<T>& conic) {
  const Mat23<T> A = projection_jacobian(camera, p);
  const Vec3<T> sigma_w = multiply(sigma, camera.cam_from_world_rotation.row2);
  const T sx = inner(A.row0, sigma_w), sy = inner(A.row1, sigma_w);
  const T a = T(1) / p.z, scale = -a * a;
  return {a, {scale * (conic.xx * sx + conic.xy * sy), scale * (conic.xy * sx + conic.yy * sy)}};
}

/// What surface terms blend of a splat: numbers that are the same at all pixels, so that their sums
/// of weights are sums of features. With x = pixel - (cx, cy),
///
///   1/z (pixel) = at_axis + slope . x
template <class T>
struct SplatSurface {
  T at_axis;       // 1 / world units
  Vec2<T> slope;   // 1 / (world units * pixels)
  Vec3<T> normal;  // of length 1, in camera axes, towards the camera
};

/// One row of features, and one pixel of their sums; as a gradient, dL by each.
struct alignas(16) SurfaceRow {
  SplatSurface<float> of{0, {0, 0}, {0, 0, 0}};
  float coverage = 0;  // 1 of a splat; sum of weights of a pixel
  float unused = 0;    // so that rows are whole vectors of 16 bytes
};
inline constexpr int kSurfaceNumbers = 8;
static_assert(sizeof(SurfaceRow) == kSurfaceNumbers * sizeof(float));

/// What surface terms differentiate by: a Gaussian without its opacity and color.
template <class T>
struct GaussianShape {
  Vec3<T> mean{T(0), T(0), T(0)}, log_scale{T(0), T(0), T(0)};
  Quat<T> rotation{T(0), T(0), T(0), T(0)};
};

/// What splat_surface() computes on its way, and its gradient computes again.
template <class T>
struct SurfaceTerms {
  static constexpr double kLeastVariance = 1e-30;  // world units^2; quotients of smaller ones fail

  Mat3<T> R;
  Vec3<T> variance, filtered;  // along the axes
  Sym3<T> sigma;
  Vec3<T> p, sigma_w;  // the mean in camera axes; Sigma w
  Mat23<T> A;
  Sym2<T> conic;
  Vec2<T> s;            // A Sigma w
  SplatPlane<T> plane;  // about the mean
  Vec2<T> from_axis;    // of the mean, pixels
  Vec3<T> e, ratio, k;  // mean - eye in world axes; k = ratio * R^T e
  T length;             // of k

  GS_HD SurfaceTerms(const PinholeCamera<T>& camera, const GaussianShape<T>& shape,
                     const T& filter_scale, const SplatSettings& settings)
      : R(rotation_matrix(shape.rotation)), variance(gs::variance(shape.log_scale)),
        filtered(filtered_variance(variance, filter_scale)), sigma(covariance(R, filtered)),
        p(to_camera(camera, shape.mean)),
        sigma_w(multiply(sigma, camera.cam_from_world_rotation.row2)),
        A(projection_jacobian(camera, p)),
        conic(conic_of(project_covariance(A, sigma, blur_of<T>(settings)))),
        s(inner(A.row0, sigma_w), inner(A.row1, sigma_w)),
        plane(splat_plane(camera, p, sigma, conic)),
        from_axis(camera.fx * p.x / p.z, camera.fy * p.y / p.z),
        e(multiply_transposed(camera.cam_from_world_rotation, p)) {
    using std::sqrt;
    const T least = T(kLeastVariance);
    const Vec3<T> v{max_of(filtered.x, least), max_of(filtered.y, least),
                    max_of(filtered.z, least)};
    const T smallest = min_of(min_of(v.x, v.y), v.z);
    ratio = {smallest / v.x, smallest / v.y, smallest / v.z};
    k = multiply_transposed(R, e) * ratio;
    length = sqrt(inner(k, k));
  }
};

/// The surface of a splat. Its normal is that of the plane on which rays meet the most of the
/// Gaussian, for a flat one its shortest axis:
///
///   n = -Sigma^-1 (mean - eye) / |..|
///
/// For a pinhole and a Gaussian that it sees.
template <class T>
GS_HD SplatSurface<T> splat_surface(const PinholeCamera<T>& camera, const GaussianShape<T>& shape,
                                    const T& filter_scale, const SplatSettings& settings) {
  const SurfaceTerms<T> terms(camera, shape, filter_scale, settings);
  const Vec3<T> n = multiply(terms.R, terms.k) * (T(-1) / terms.length);
  return {terms.plane.at(-terms.from_axis), terms.plane.slope,
          multiply(camera.cam_from_world_rotation, n)};
}

/// Gradients of splat_surface() by the Gaussian; the filter is a constant. With a = 1/z, the slope h
/// and g of splat_plane(),
///
///   dL/dz = -a^2 G_a - 2 (h . G_h) / z,   G_g = -a^2 G_h,   G_s = Q G_g,   G_Q = G_g s^T
///   dL/dA = G_s (Sigma w)^T,   dL/dSigma = A^T G_s w^T      each symmetrized where its matrix is
///
/// and with y = R^T e, k = y ratio and d = dL/dk = -(R^T G_n - k^ (k^ . R^T G_n)) / |k|,
///
///   dL/dR = -G_n k^^T + e (ratio d)^T,   dL/dmean = R (ratio d),   dL/ds_j = -2 k_j d_j v_j / v'_j
///
/// where v' is the variance v with the filter. The smallest variance in `ratio` has no gradient,
/// since k . d = 0.
template <class T>
GS_HD GaussianShape<T> splat_surface_vjp(const PinholeCamera<T>& camera,
                                         const GaussianShape<T>& shape, const T& filter_scale,
                                         const SplatSettings& settings, const SplatSurface<T>& dL) {
  const SurfaceTerms<T> at(camera, shape, filter_scale, settings);
  const Vec3<T>& w = camera.cam_from_world_rotation.row2;
  const T a = at.plane.at_mean;
  const Vec2<T>& h = at.plane.slope;

  // The plane.
  const Vec2<T> G_h = dL.slope - at.from_axis * dL.at_axis;
  const Vec2<T> G_g = G_h * (-a * a);
  const Sym2<T>& Q = at.conic;
  const Vec2<T> G_s{Q.xx * G_g.x + Q.xy * G_g.y, Q.xy * G_g.x + Q.yy * G_g.y};
  const Sym2<T> G_Q{G_g.x * at.s.x, (G_g.x * at.s.y + G_g.y * at.s.x) * T(0.5), G_g.y * at.s.y};
  ProjectCovarianceGradient<T> by = project_covariance_vjp(at.A, at.sigma, conic_vjp(Q, G_Q));
  by.A.row0 += at.sigma_w * G_s.x;
  by.A.row1 += at.sigma_w * G_s.y;
  const Vec3<T> b = at.A.row0 * G_s.x + at.A.row1 * G_s.y;  // A^T G_s
  by.sigma.xx += b.x * w.x;
  by.sigma.yy += b.y * w.y;
  by.sigma.zz += b.z * w.z;
  by.sigma.xy += (b.x * w.y + b.y * w.x) * T(0.5);
  by.sigma.xz += (b.x * w.z + b.z * w.x) * T(0.5);
  by.sigma.yz += (b.y * w.z + b.z * w.y) * T(0.5);
  Vec3<T> G_p = project_mean_vjp(camera, at.p, h * (-dL.at_axis)) +
                projection_jacobian_vjp(camera, at.p, by.A);
  G_p.z += -a * a * dL.at_axis - T(2) * a * inner(h, G_h);
  CovarianceGradient<T> by_covariance = covariance_vjp(at.R, at.filtered, by.sigma);

  // The normal.
  const Vec3<T> G_n = multiply_transposed(camera.cam_from_world_rotation, dL.normal);
  const Vec3<T> k = at.k / at.length, r = multiply_transposed(at.R, G_n);
  const Vec3<T> d = (r - k * inner(k, r)) * (T(-1) / at.length);
  const Vec3<T> by_y = at.ratio * d;
  by_covariance.R.row0 += by_y * at.e.x - k * G_n.x;
  by_covariance.R.row1 += by_y * at.e.y - k * G_n.y;
  by_covariance.R.row2 += by_y * at.e.z - k * G_n.z;

  GaussianShape<T> gradient;
  gradient.mean = to_camera_vjp(camera, G_p) + multiply(at.R, by_y);
  gradient.log_scale = variance_vjp(at.variance, by_covariance.variance) -
                       T(2) * at.k * d * at.variance / at.filtered;
  gradient.rotation = rotation_matrix_vjp(shape.rotation, by_covariance.R);
  return gradient;
}

/// The row of a visible Gaussian, and the gradient by it. What is not finite counts as nothing.
GS_HD SurfaceRow surface_row(const PinholeCamera<float>& camera, const GaussianShape<float>& shape,
                             float filter_scale, const SplatSettings& settings) {
  const SplatSurface<float> surface = splat_surface(camera, shape, filter_scale, settings);
  const float sum = surface.at_axis + surface.slope.x + surface.slope.y;
  if (!(sum - sum == 0.0f) || !is_finite(surface.normal)) return {};
  return {surface, 1};
}
GS_HD GaussianShape<float> surface_row_vjp(const PinholeCamera<float>& camera,
                                           const GaussianShape<float>& shape, float filter_scale,
                                           const SplatSettings& settings, const SurfaceRow& dL) {
  const GaussianShape<float> gradient =
      splat_surface_vjp(camera, shape, filter_scale, settings, dL.of);
  const Quatf& q = gradient.rotation;
  const Vec3f sum = gradient.mean + gradient.log_scale + Vec3f(q.w + q.x + q.y + q.z);
  return is_finite(sum) ? gradient : GaussianShape<float>{};
}

}  // namespace gs
