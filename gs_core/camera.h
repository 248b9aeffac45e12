// SPDX-License-Identifier: Apache-2.0
// The camera of training and rendering: a pinhole with a pose, and a lens or none.
#pragma once

#include <algorithm>
#include <cmath>

#include "gs_core/lens.h"
#include "gs_core/types.h"

namespace gs {

/// Pinhole camera, mostly an undistorted one. Pixel (i, j) has its center at (i + 0.5, j + 0.5), as
/// in COLMAP; camera axes are x right, y down, z forward. Stages 1 and 7 see through its lens; code
/// that knows pinholes alone takes without_lens().
template <class T>
struct PinholeCamera {
  int width = 0, height = 0;  // pixels
  T fx{}, fy{}, cx{}, cy{};   // pixels
  Mat3<T> cam_from_world_rotation{{T(1), T(0), T(0)}, {T(0), T(1), T(0)}, {T(0), T(0), T(1)}};
  Vec3<T> cam_from_world_translation{T(0), T(0), T(0)};  // world units
  // When the picture is taken: 0 is the scene's begin, 1 its end. Only Gaussians in space and time
  // look at it.
  T time{};
  CameraLens<T> lens{};  // Lens::none, unless photos train as they were taken (dataset.lens)

  GS_HD bool has_lens() const { return lens.lens != Lens::none; }
  /// Whether it moves while its rows are exposed. Such a camera has a lens, if need be one without
  /// coefficients.
  GS_HD bool has_rolling_shutter() const { return has_lens() && lens.motion.is_any(); }
  /// The camera center in world space.
  GS_HD Vec3<T> position() const {
    return -multiply_transposed(cam_from_world_rotation, cam_from_world_translation);
  }
};
using Camera = PinholeCamera<float>;

/// The pinhole with the same center, focal lengths and size.
template <class T>
PinholeCamera<T> without_lens(PinholeCamera<T> camera) {
  camera.lens = {};
  return camera;
}

/// The camera with a lens as it moves from the first row of its picture to the last. Its rows keep
/// their times where the picture is cut or scaled.
template <class T>
PinholeCamera<T> with_motion(PinholeCamera<T> camera, const RigidMotion<T>& motion) {
  camera.lens.motion = motion;
  camera.lens.rows = {-camera.cy / camera.fy, (T(camera.height) - camera.cy) / camera.fy};
  return camera;
}

/// The camera of the same view at another picture size: focal lengths and center scale with the
/// true ratio of each axis.
template <class T>
PinholeCamera<T> resized(PinholeCamera<T> camera, int width, int height) {
  const T sx = T(width) / T(camera.width), sy = T(height) / T(camera.height);
  camera.fx *= sx;
  camera.cx *= sx;
  camera.fy *= sy;
  camera.cy *= sy;
  camera.width = width;
  camera.height = height;
  return camera;
}

/// The longer side, in pixels, to which larger photos are reduced unless a -r says otherwise; the
/// trainer of Kerbl et al. 2023 reduces the width to it.
inline constexpr int kUsualSide = 1600;

/// The factor of both sides of a picture at a -r/--resolution: 1 to 8 divides them, a larger number
/// is the new width in pixels, and 0 leaves the longer side kUsualSide pixels at most.
inline double scale_at_resolution(int width, int height, int resolution) {
  if (resolution == 0) return std::min(1.0, double(kUsualSide) / std::max(width, height));
  return resolution <= 8 ? 1.0 / resolution : double(resolution) / width;
}

/// The same view at a -r/--resolution. Sides are rounded to the nearest pixel, and are at least 1.
template <class T>
PinholeCamera<T> at_resolution(const PinholeCamera<T>& camera, int resolution) {
  const double scale = scale_at_resolution(camera.width, camera.height, resolution);
  const auto side = [&](int pixels) { return std::max(1, int(std::lround(pixels * scale))); };
  return resized(camera, side(camera.width), side(camera.height));
}

/// The same camera in another scalar.
template <class To, class From>
PinholeCamera<To> camera_as(const PinholeCamera<From>& camera) {
  const Mat3<From>& W = camera.cam_from_world_rotation;
  return {camera.width,
          camera.height,
          To(camera.fx),
          To(camera.fy),
          To(camera.cx),
          To(camera.cy),
          {Vec3<To>(W.row0), Vec3<To>(W.row1), Vec3<To>(W.row2)},
          Vec3<To>(camera.cam_from_world_translation),
          To(camera.time),
          lens_as<To>(camera.lens)};
}

}  // namespace gs
