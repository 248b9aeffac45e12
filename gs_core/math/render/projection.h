// SPDX-License-Identifier: Apache-2.0
// Stage 1: from world space to the image plane: mean, covariance (EWA, Zwicker et al. 2001), conic,
// and the opacity compensation of the antialiased mode.
#pragma once

#include "gs_core/camera.h"
#include "gs_core/math/constants.h"
#include "gs_core/math/lens/rolling_shutter.h"
#include "gs_core/types.h"

namespace gs {

/// World to camera space: p = W mu + t.   world units
template <class T>
GS_HD Vec3<T> to_camera(const PinholeCamera<T>& camera, const Vec3<T>& mean) {
  return multiply(camera.cam_from_world_rotation, mean) + camera.cam_from_world_translation;
}
/// dL/dmu of to_camera().
template <class T>
GS_HD Vec3<T> to_camera_vjp(const PinholeCamera<T>& camera, const Vec3<T>& dL_dp) {
  return multiply_transposed(camera.cam_from_world_rotation, dL_dp);
}

/// Image-plane mean of a point p in camera space, p.z > 0, of a pinhole.   pixels
template <class T>
GS_HD Vec2<T> project_mean(const PinholeCamera<T>& camera, const Vec3<T>& p) {
  return {camera.fx * p.x / p.z + camera.cx, camera.fy * p.y / p.z + camera.cy};
}
/// dL/dp of project_mean().
template <class T>
GS_HD Vec3<T> project_mean_vjp(const PinholeCamera<T>& camera, const Vec3<T>& p,
                               const Vec2<T>& dL_dmean2d) {
  const T gx = camera.fx / p.z * dL_dmean2d.x, gy = camera.fy / p.z * dL_dmean2d.y;
  return {gx, gy, -(gx * p.x + gy * p.y) / p.z};
}

/// The range of x/z (and y/z) inside which the Jacobian follows the point: the picture and a margin
/// of 0.15 of its size on each side. For a centered camera this is 1.3 tan(fov / 2).
///                                                                        Kerbl et al. 2023, code
template <class T>
struct FrustumLimits {
  Vec2<T> low, high;
};
template <class T>
GS_HD FrustumLimits<T> frustum_limits(const PinholeCamera<T>& camera) {
  const T w = T(camera.width), h = T(camera.height), m = T(kFrustumMargin);
  return {{(-m * w - camera.cx) / camera.fx, (-m * h - camera.cy) / camera.fy},
          {((T(1) + m) * w - camera.cx) / camera.fx, ((T(1) + m) * h - camera.cy) / camera.fy}};
}

/// A = J W: the first-order change of a pinhole's mean by the world position.  pixels / world unit
///
///   J = [ fx/z   0    -fx x/z^2 ]    with x/z, y/z clamped to frustum_limits()
///       [  0    fy/z  -fy y/z^2 ]                                Kerbl et al. 2023, Eq. 5
template <class T>
GS_HD Mat23<T> projection_jacobian(const PinholeCamera<T>& camera, const Vec3<T>& p) {
  const FrustumLimits<T> limits = frustum_limits(camera);
  const T x = clamp_to(p.x / p.z, limits.low.x, limits.high.x);
  const T y = clamp_to(p.y / p.z, limits.low.y, limits.high.y);
  const T jx = camera.fx / p.z, jy = camera.fy / p.z;
  const Mat3<T>& W = camera.cam_from_world_rotation;
  return {jx * (W.row0 - x * W.row2), jy * (W.row1 - y * W.row2)};
}
/// dL/dp of projection_jacobian(): through 1/z always, through x/z and y/z only inside the limits.
template <class T>
GS_HD Vec3<T> projection_jacobian_vjp(const PinholeCamera<T>& camera, const Vec3<T>& p,
                                      const Mat23<T>& dL_dA) {
  const FrustumLimits<T> limits = frustum_limits(camera);
  const T x_free = p.x / p.z, y_free = p.y / p.z;
  const T x = clamp_to(x_free, limits.low.x, limits.high.x);
  const T y = clamp_to(y_free, limits.low.y, limits.high.y);
  const T x_moves = x == x_free ? T(1) : T(0), y_moves = y == y_free ? T(1) : T(0);
  const T jx = camera.fx / p.z, jy = camera.fy / p.z;
  const Mat3<T>& W = camera.cam_from_world_rotation;
  const T d_jx = inner(dL_dA.row0, W.row0 - x * W.row2),
          d_jy = inner(dL_dA.row1, W.row1 - y * W.row2);
  const T d_x = -jx * inner(dL_dA.row0, W.row2) * x_moves,
          d_y = -jy * inner(dL_dA.row1, W.row2) * y_moves;
  return {d_x / p.z, d_y / p.z, -(jx * d_jx + jy * d_jy + x_free * d_x + y_free * d_y) / p.z};
}

/// Where p is seen, through the lens if there is one, and when its row is exposed.
template <class T>
GS_HD ProjectedPoint<T> project_point(const PinholeCamera<T>& camera, const Vec3<T>& p) {
  if (camera.has_rolling_shutter()) return project_through_shutter(camera, p);
  if (camera.has_lens()) return project_through_lens(camera, p);
  return {project_mean(camera, p), projection_jacobian(camera, p)};
}
/// Image-plane mean of a point in camera space that is_in_sight().   pixels
template <class T>
GS_HD Vec2<T> pixel_of(const PinholeCamera<T>& camera, const Vec3<T>& p) {
  return camera.has_lens() ? project_point(camera, p).mean2d : project_mean(camera, p);
}

/// dL/dp of project_point().
template <class T>
GS_HD Vec3<T> project_point_vjp(const PinholeCamera<T>& camera, const Vec3<T>& p,
                                const Vec2<T>& dL_dmean2d, const Mat23<T>& dL_dA) {
  if (camera.has_rolling_shutter())
    return project_through_shutter_vjp(camera, p, dL_dmean2d, dL_dA);
  if (camera.has_lens()) return project_through_lens_vjp(camera, p, dL_dmean2d, dL_dA);
  return project_mean_vjp(camera, p, dL_dmean2d) + projection_jacobian_vjp(camera, p, dL_dA);
}

/// Image-plane covariance: Sigma' = A Sigma A^T + blur I   Kerbl et al. 2023, Eq. 5
///
/// A      of project_point() at the Gaussian's mean      pixels / world unit
/// sigma  world covariance                               world units^2
/// blur   low-pass added to the diagonal                 pixels^2
/// Returns a symmetric matrix in pixels^2, positive definite for blur > 0.
template <class T>
GS_HD Sym2<T> project_covariance(const Mat23<T>& A, const Sym3<T>& sigma, const T& blur) {
  const Vec3<T> b0 = multiply(sigma, A.row0), b1 = multiply(sigma, A.row1);
  return {inner(A.row0, b0) + blur, inner(A.row0, b1), inner(A.row1, b1) + blur};
}
template <class T>
struct ProjectCovarianceGradient {
  Mat23<T> A;
  Sym3<T> sigma;
};
/// Gradients of project_covariance(): dL/dA = 2 G A Sigma, dL/dSigma = A^T G A, with G =
/// dL/dSigma'.
template <class T>
GS_HD ProjectCovarianceGradient<T> project_covariance_vjp(const Mat23<T>& A, const Sym3<T>& sigma,
                                                          const Sym2<T>& dL_dcov2d) {
  const Sym2<T>& G = dL_dcov2d;
  const Vec3<T> b0 = multiply(sigma, A.row0), b1 = multiply(sigma, A.row1);
  const Vec3<T> g0 = G.xx * A.row0 + G.xy * A.row1, g1 = G.xy * A.row0 + G.yy * A.row1;
  return {{T(2) * (G.xx * b0 + G.xy * b1), T(2) * (G.xy * b0 + G.yy * b1)},
          {A.row0.x * g0.x + A.row1.x * g1.x, A.row0.x * g0.y + A.row1.x * g1.y,
           A.row0.x * g0.z + A.row1.x * g1.z, A.row0.y * g0.y + A.row1.y * g1.y,
           A.row0.y * g0.z + A.row1.y * g1.z, A.row0.z * g0.z + A.row1.z * g1.z}};
}

/// xx yy - xy^2. For a needle this is a small difference of two large products.
template <class T>
GS_HD T determinant(const Sym2<T>& S) {
  return sum_of_products(S.xx, S.yy, -S.xy, S.xy);
}

/// The conic Q = Sigma'^-1, whose quadratic form is the exponent of a splat.   1 / pixels^2
template <class T>
GS_HD Sym2<T> conic_of(const Sym2<T>& cov2d) {
  const T inverse = T(1) / determinant(cov2d);
  return {cov2d.yy * inverse, -cov2d.xy * inverse, cov2d.xx * inverse};
}
/// dL/dSigma' of conic_of(), given the conic: -Q G Q with G = dL/dQ.
template <class T>
GS_HD Sym2<T> conic_vjp(const Sym2<T>& conic, const Sym2<T>& dL_dconic) {
  const Sym2<T>&Q = conic, &G = dL_dconic;
  const T m00 = G.xx * Q.xx + G.xy * Q.xy, m01 = G.xx * Q.xy + G.xy * Q.yy;  // G Q
  const T m10 = G.xy * Q.xx + G.yy * Q.xy, m11 = G.xy * Q.xy + G.yy * Q.yy;
  return {-(Q.xx * m00 + Q.xy * m10), -(Q.xx * m01 + Q.xy * m11), -(Q.xy * m01 + Q.yy * m11)};
}

/// Opacity compensation of the antialiased mode: sqrt(max(|S| / |S + blur I|, 0)), where S is the
/// covariance before the blur. It keeps a splat's energy when the blur widens it.   Yu et al. 2024
///
/// cov2d  covariance with the blur added   pixels^2
template <class T>
GS_HD T antialias_factor(const Sym2<T>& cov2d, const T& blur) {
  using std::sqrt;
  const Sym2<T> raw{cov2d.xx - blur, cov2d.xy, cov2d.yy - blur};
  const T ratio = determinant(raw) / determinant(cov2d);
  return ratio > T(0) ? sqrt(ratio) : T(0);
}
/// dL/dSigma' of antialias_factor(); zero where the factor is.
template <class T>
GS_HD Sym2<T> antialias_factor_vjp(const Sym2<T>& cov2d, const T& blur, const T& dL_dfactor) {
  const T factor = antialias_factor(cov2d, blur);
  if (!(factor > T(0))) return {T(0), T(0), T(0)};
  const Sym2<T> raw{cov2d.xx - blur, cov2d.xy, cov2d.yy - blur};
  const T det_raw = determinant(raw), det = determinant(cov2d);
  const T half = T(0.5) * factor * dL_dfactor;  // d log(ratio) * ratio / (2 factor)
  return {half * (raw.yy / det_raw - cov2d.yy / det), -half * (cov2d.xy / det_raw - cov2d.xy / det),
          half * (raw.xx / det_raw - cov2d.xx / det)};
}

}  // namespace gs
