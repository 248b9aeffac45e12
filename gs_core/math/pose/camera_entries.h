// SPDX-License-Identifier: Apache-2.0
// Stage 7 for callers who differentiate by the camera itself: from the gradient of a splat to that
// of every entry of its matrices. camera_gradient.h has the gradient by a rigid motion.
#pragma once

#include "gs_core/math/render/splat.h"

namespace gs {

/// dL by each number of a camera but its lens, all of them free: also the nine of a rotation.
template <class T>
struct CameraEntriesGradient {
  Mat3<T> rotation{{T(0), T(0), T(0)}, {T(0), T(0), T(0)}, {T(0), T(0), T(0)}};
  Vec3<T> translation{T(0), T(0), T(0)};
  T fx{0}, fy{0}, cx{0}, cy{0};

  GS_HD void add(const CameraEntriesGradient& other) {
    rotation.row0 += other.rotation.row0;
    rotation.row1 += other.rotation.row1;
    rotation.row2 += other.rotation.row2;
    translation += other.translation;
    fx += other.fx, fy += other.fy, cx += other.cx, cy += other.cy;
  }
};

/// camera_entries_vjp() through a lens, whose range does not move with the camera. With A = B W,
/// where B = F D J of project_through_lens():
///
///   dL/dW_k = sum_i B_ik J'_i + dL/dp_k mu     dL/dt = dL/dp
///   dL/dfx = u (mean2d.x - cx) / fx + <J'_0, A_0> / fx,   dL/dcx = u
template <class T>
GS_HD CameraEntriesGradient<T> lens_camera_entries_vjp(const PinholeCamera<T>& camera,
                                                       const Vec3<T>& mean,
                                                       const EllipsoidInCameraGradient<T>& dL,
                                                       const Vec2<T>& dL_dmean2d) {
  PinholeCamera<T> upright = camera;  // its A is B
  upright.cam_from_world_rotation = {{T(1), T(0), T(0)}, {T(0), T(1), T(0)}, {T(0), T(0), T(1)}};
  const ProjectedPoint<T> at = project_through_lens(upright, to_camera(camera, mean));
  const Mat3<T>& W = camera.cam_from_world_rotation;
  const Vec3<T>&B0 = at.A.row0, &B1 = at.A.row1, &G0 = dL.A.row0, &G1 = dL.A.row1;
  CameraEntriesGradient<T> gradient;
  gradient.rotation = {B0.x * G0 + B1.x * G1 + dL.p.x * mean, B0.y * G0 + B1.y * G1 + dL.p.y * mean,
                       B0.z * G0 + B1.z * G1 + dL.p.z * mean};
  gradient.translation = dL.p;
  gradient.fx = (dL_dmean2d.x * (at.mean2d.x - camera.cx) + inner(multiply(W, G0), B0)) / camera.fx;
  gradient.fy = (dL_dmean2d.y * (at.mean2d.y - camera.cy) + inner(multiply(W, G1), B1)) / camera.fy;
  gradient.cx = dL_dmean2d.x;
  gradient.cy = dL_dmean2d.y;
  return gradient;
}

/// The share of one visible ellipsoid in the gradient by the camera, its color's left out. With
/// J' = dL/dA, where A has the rows fx/z (W_0 - x W_2) and fy/z (W_1 - y W_2), and dL/dp of
/// p = W mu + t:
///
///   dL/dW_0 = fx/z J'_0     dL/dW_1 = fy/z J'_1     dL/dW_2 = -(fx/z x J'_0 + fy/z y J'_1)
///   and dL/dp mu^T          dL/dt = dL/dp
///   dL/dfx = u (p_x/p_z) + <J'_0, A_0> / fx,   dL/dcx = u,   u = dL/d(mean2d).x;  and so for y
///
/// Where x is one of frustum_limits(), it moves with fx and cx:  dx/dfx = -x/fx,  dx/dcx = -1/fx.
///
/// mean     of the ellipsoid, in world coordinates
/// dL       of project_ellipsoid_in_camera_vjp()
/// dL_dmean2d   as in the gradient of the splat
template <class T>
GS_HD CameraEntriesGradient<T> camera_entries_vjp(const PinholeCamera<T>& camera,
                                                  const Vec3<T>& mean,
                                                  const EllipsoidInCameraGradient<T>& dL,
                                                  const Vec2<T>& dL_dmean2d) {
  if (camera.has_lens()) return lens_camera_entries_vjp(camera, mean, dL, dL_dmean2d);
  const Vec3<T> p = to_camera(camera, mean);
  const FrustumLimits<T> limits = frustum_limits(camera);
  const T x_free = p.x / p.z, y_free = p.y / p.z;
  const T x = clamp_to(x_free, limits.low.x, limits.high.x);
  const T y = clamp_to(y_free, limits.low.y, limits.high.y);
  const T jx = camera.fx / p.z, jy = camera.fy / p.z;
  const Mat3<T>& W = camera.cam_from_world_rotation;

  CameraEntriesGradient<T> gradient;
  gradient.rotation = {jx * dL.A.row0 + dL.p.x * mean, jy * dL.A.row1 + dL.p.y * mean,
                       T(-1) * (jx * x * dL.A.row0 + jy * y * dL.A.row1) + dL.p.z * mean};
  gradient.translation = dL.p;
  gradient.fx = dL_dmean2d.x * x_free + inner(dL.A.row0, W.row0 - x * W.row2) / p.z;
  gradient.fy = dL_dmean2d.y * y_free + inner(dL.A.row1, W.row1 - y * W.row2) / p.z;
  gradient.cx = dL_dmean2d.x;
  gradient.cy = dL_dmean2d.y;
  const T by_x = -jx * inner(dL.A.row0, W.row2), by_y = -jy * inner(dL.A.row1, W.row2);
  if (x != x_free) {
    gradient.fx -= by_x * x / camera.fx;
    gradient.cx -= by_x / camera.fx;
  }
  if (y != y_free) {
    gradient.fy -= by_y * y / camera.fy;
    gradient.cy -= by_y / camera.fy;
  }
  return gradient;
}

/// The share of a color, which depends on the camera by its center e = -W^T t:
///
///   dL/dt = -W dL/de,   dL/dW_i = -t_i dL/de
///
/// by_color  the color's part of dL/d(mean), as in ColorGradient; dL/de is its negative
template <class T>
GS_HD CameraEntriesGradient<T> camera_entries_by_color_vjp(const PinholeCamera<T>& camera,
                                                           const Vec3<T>& by_color) {
  const Vec3<T>& t = camera.cam_from_world_translation;
  CameraEntriesGradient<T> gradient;
  gradient.rotation = {t.x * by_color, t.y * by_color, t.z * by_color};
  gradient.translation = multiply(camera.cam_from_world_rotation, by_color);
  return gradient;
}

}  // namespace gs
