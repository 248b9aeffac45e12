// SPDX-License-Identifier: Apache-2.0
// The surface of a splat: where a ray through a pixel meets its Gaussian.
#pragma once

#include "gs_core/math/render/projection.h"

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

}  // namespace gs
