// SPDX-License-Identifier: Apache-2.0
// Stage 1 with the 3D smoothing filter of Mip-Splatting: photos hold no detail finer than their
// pixels, so that a Gaussian finer than these is an artifact, which shows when a camera comes
// closer than those of the photos.   Yu et al. 2024, Sec. 4.1
#pragma once

#include "gs_core/math/constants.h"
#include "gs_core/math/render/projection.h"

namespace gs {

/// How densely a camera samples space at a point: focal length / depth, of the finer axis. Of a
/// fisheye, focal length / distance; of Lens::orthographic, focal length.
///
/// mean        world units
/// near_plane  world units along the viewing axis
/// Returns pixels per world unit; 0 if the camera does not see the point: it is nearer than
/// near_plane, or beyond the picture and a margin of kFrustumMargin of its size on each side.
template <class T>
GS_HD T sampling_rate(const PinholeCamera<T>& camera, const Vec3<T>& mean, const T& near_plane) {
  using std::sqrt;
  const Vec3<T> p = to_camera(camera, mean);
  if (!(depth_of(camera, p) >= near_plane)) return T(0);
  // Pixels times depth, so that there is no division for most cameras.
  T x = camera.fx * p.x + camera.cx * p.z, y = camera.fy * p.y + camera.cy * p.z, z = p.z;
  if (camera.has_lens()) {
    if (!is_in_sight(camera, p)) return T(0);
    if (has_angle_chart(camera.lens.lens)) z = sqrt(inner(p, p));
    if (camera.lens.lens == Lens::orthographic) z = T(1);
    const Vec2<T> pixel = pixel_of(camera, p);
    x = pixel.x * z, y = pixel.y * z;
  }
  const T w = T(camera.width) * z, h = T(camera.height) * z, m = T(kFrustumMargin);
  const bool is_seen = x >= -m * w && x <= (T(1) + m) * w && y >= -m * h && y <= (T(1) + m) * h;
  return is_seen ? max_of(camera.fx, camera.fy) / z : T(0);
}

/// The filter of a Gaussian, from the largest sampling rate of all training cameras, above 0:
///
///   f = sqrt(0.2) / rate
///
/// Returns its standard deviation   world units
template <class T>
GS_HD T filter_scale_of(const T& rate) {
  using std::sqrt;
  return sqrt(T(kFilter3dVariance)) / rate;
}

/// Variances along the Gaussian's axes after the filter: Sigma' = Sigma + f^2 I has the axes of
/// Sigma.   world units^2
template <class T>
GS_HD Vec3<T> filtered_variance(const Vec3<T>& variance, const T& filter_scale) {
  return variance + Vec3<T>(filter_scale * filter_scale);
}

/// The opacity's factor, which keeps the Gaussian's integral when the filter widens it:
///
///   c = sqrt(|Sigma| / |Sigma + f^2 I|)
///
/// variance  along the axes   world units^2
/// Returns 0..1; 1 for f = 0.
template <class T>
GS_HD T filter_factor(const Vec3<T>& variance, const T& filter_scale) {
  using std::sqrt;
  if (!(filter_scale > T(0))) return T(1);  // also where a variance is too small for a number
  const Vec3<T> ratio = variance / filtered_variance(variance, filter_scale);
  return sqrt(ratio.x * ratio.y * ratio.z);
}
/// Gradient of filter_factor() by the log of the scales: dc/ds_k = c f^2 / (v_k + f^2). By the
/// logs, because that by the variances is not finite for the smallest ones.
template <class T>
GS_HD Vec3<T> filter_factor_vjp(const Vec3<T>& variance, const T& filter_scale, const T& factor,
                                const T& dL_dfactor) {
  if (!(filter_scale > T(0))) return Vec3<T>(T(0));
  const T weight = dL_dfactor * factor * filter_scale * filter_scale;
  const Vec3<T> filtered = filtered_variance(variance, filter_scale);
  return {weight / filtered.x, weight / filtered.y, weight / filtered.z};
}

}  // namespace gs
