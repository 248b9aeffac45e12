// SPDX-License-Identifier: Apache-2.0
// Stages 1, 2 and 4 of the order by pixel: how far along the ray of a pixel a Gaussian is. It does
// not depend on where the camera looks, only on where it is, so that nothing changes its place when
// the camera turns.   Radl et al. 2024 (StopThePop)
#pragma once

#include "gs_core/math/render/splat.h"

namespace gs {

/// Where the rays of a view meet the most of one Gaussian, at an offset d from its image-plane mean:
///
///   t = (Sigma^-1 m . r) / (r . Sigma^-1 r)     m mean, r ray, from the eye, both in world axes
///     = z u / (u^2 + v^2 + w^2)                 u = 1 + u . d,  v = v . d,  w = w d_y
///
/// With Sigma^-1 = M^T M, the three terms are those of M r, which is affine in the pixel, turned so
/// that M m has one term alone. Unlike the terms of r . Sigma^-1 r they do not cancel, however flat
/// a Gaussian is. r has a depth of 1, so that t is a depth as well.
template <class T>
struct alignas(8) RayDepth {
  T depth;       // of the mean, world units
  Vec2<T> u, v;  // 1 / pixels
  T w;           // 1 / pixels

  /// The depth at an offset from the mean, pixels. At most 0: the most of it lies behind the eye.
  GS_HD T at(const T& dx, const T& dy) const {
    const T a = multiply_add(u.x, dx, multiply_add(u.y, dy, T(1)));
    const T b = multiply_add(v.x, dx, v.y * dy), c = w * dy;
    return depth * a / multiply_add(a, a, multiply_add(b, b, c * c));
  }
};

/// Of a visible Gaussian in front of a pinhole, which counts as at least kLeastThickness as thick as
/// it is long. It has no gradient: an order has none.
template <class T>
GS_HD RayDepth<T> ray_depth(const PinholeCamera<T>& camera, const GaussianParameters<T>& gaussian) {
  using std::sqrt;
  const Mat3<T> R = rotation_matrix(gaussian.rotation);
  const Vec3<T> variances = filtered_variance(variance(gaussian.log_scale), gaussian.filter_scale);
  const T largest = max_of(max_of(variances.x, variances.y), variances.z);
  const T least = T(kLeastThickness * kLeastThickness) * largest;
  const auto weight = [&](const T& v) {  // of a point, which has no shape: 1
    return largest > T(1e-30) ? sqrt(largest / max_of(v, least)) : T(1);
  };
  const Vec3<T> weights{weight(variances.x), weight(variances.y), weight(variances.z)};
  const auto whitened = [&](const Vec3<T>& r) { return weights * multiply_transposed(R, r); };
  const Mat3<T>& W = camera.cam_from_world_rotation;
  const T depth = to_camera(camera, gaussian.mean).z;
  // M m, and the change of M r from pixel to pixel; then Gram-Schmidt.
  const Vec3<T> m = whitened((gaussian.mean - camera.position()) * (T(1) / depth));
  const Vec3<T> x = whitened(W.row0 * (T(1) / camera.fx)),
                y = whitened(W.row1 * (T(1) / camera.fy));
  const T scale = T(1) / sqrt(inner(m, m));
  const Vec3<T> first = m * scale;
  const T x_first = inner(first, x), y_first = inner(first, y);
  const Vec3<T> x_rest = x - x_first * first, y_rest = y - y_first * first;
  const T length = sqrt(inner(x_rest, x_rest));
  const Vec3<T> second = x_rest * (T(1) / length);
  const T y_second = inner(second, y_rest);
  const Vec3<T> y_left = y_rest - y_second * second;
  return {depth,
          {x_first * scale, y_first * scale},
          {length * scale, y_second * scale},
          sqrt(inner(y_left, y_left)) * scale};
}

}  // namespace gs
