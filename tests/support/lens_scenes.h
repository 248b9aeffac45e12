// SPDX-License-Identifier: Apache-2.0
// Cameras with lenses, and Gaussians at the angles from the axis where these differ from pinholes.
#pragma once

#include "data_loaders/lenses/lens_range.h"
#include "gs_core/math/render/rotation.h"
#include "tests/support/scenes.h"

namespace gs {

/// The camera at its place with the lens of a COLMAP model. `params` are those of pictures whose
/// sides are 1, in COLMAP's order: one or two focal lengths and the center come first. `motion` is
/// that of a rolling shutter.
inline Camera with_lens(const Camera& at, CameraModel model, std::vector<double> params,
                        const RigidMotion<float>& motion = {}) {
  const bool has_one_focal =
      model == CameraModel::simple_fisheye || model == CameraModel::simple_radial;
  const double sides[] = {double(at.width), double(at.height)};
  for (std::size_t i = 0; i < (has_one_focal ? 3 : 4); ++i)
    params[i] *= has_one_focal ? sides[i == 2] : sides[i % 2];
  const LensCamera lens = lens_camera({1, model, at.width, at.height, params}, "a.jpg");
  Camera result =
      camera_as<float>(motion.is_any() ? row_by_row_camera(lens, LensUse::native, "a.jpg")
                                       : camera_with_lens(lens, "a.jpg"));
  if (motion.is_any()) result = with_motion(result, motion);
  result.cam_from_world_rotation = at.cam_from_world_rotation;
  result.cam_from_world_translation = at.cam_from_world_translation;
  result.time = at.time;
  return result;
}

/// Moves Gaussians to angles between `least` and `most` (radians) from the camera's axis, on the
/// side where pictures have more rows, and makes them some pixels large.
inline Gaussians at_angles(Gaussians gaussians, const Camera& camera, float least, float most,
                           std::uint64_t seed) {
  Draws draws(seed);
  for (std::size_t i = 0; i < gaussians.count(); ++i) {
    const float theta = draws.uniform(least, most), turn = 1.57f + draws.uniform(-0.6f, 0.6f);
    const float distance = draws.uniform(1, 4);
    const Vec3f p = distance * Vec3f(std::sin(theta) * std::cos(turn),
                                     std::sin(theta) * std::sin(turn), std::cos(theta));
    gaussians.mean[i] =
        multiply_transposed(camera.cam_from_world_rotation, p - camera.cam_from_world_translation);
    for (int axis = 0; axis < 3; ++axis)
      gaussians.log_scale[i][axis] =
          std::log(distance * draws.uniform(1.0f, 4.0f) / std::max(camera.fx, camera.fy));
  }
  return gaussians;
}

/// What tests see through lenses: a strong one, fisheyes within and beyond 90 degrees, and cameras
/// that move while their rows are exposed.
struct LensScene {
  const char* name;
  CameraModel model;
  std::vector<double> params;  // of with_lens()
  float least, most;           // of at_angles()
  RigidMotion<float> motion{};
};
inline const std::vector<LensScene>& lens_scenes() {
  static const std::vector<LensScene> all = {
      {"strong OPENCV",
       CameraModel::opencv,
       {0.7, 0.7, 0.5, 0.3, -0.25, 0.05, 2e-3, -3e-3},
       0,
       0.9f},
      {"OPENCV beyond its fold",
       CameraModel::opencv,
       {0.5, 0.6, 0.5, 0.3, -0.4, 0, 0, 0},
       0.5f,
       1.2f},
      {"OPENCV_FISHEYE at 80 degrees",
       CameraModel::opencv_fisheye,
       {0.45, 0.6, 0.5, 0.1, -0.02, 0.005, -0.002, 0.001},
       1.0f,
       1.5f},
      {"OPENCV_FISHEYE beyond 90 degrees",
       CameraModel::opencv_fisheye,
       {0.38, 0.5, 0.5, 0.1, 0.02, -0.01, 0.003, -4e-4},
       1.3f,
       1.95f},
      {"equidistant", CameraModel::simple_fisheye, {0.4, 0.5, 0.1}, 0, 2.0f},
      {"moving pinhole",
       CameraModel::pinhole,
       {0.7, 0.7, 0.5, 0.3},
       0,
       0.9f,
       {{0.08f, -0.1f, 0.12f}, {0.15f, -0.1f, 0.2f}}},
      {"moving fisheye",
       CameraModel::opencv_fisheye,
       {0.38, 0.5, 0.5, 0.1, 0.02, -0.01, 0.003, -4e-4},
       0.5f,
       1.95f,
       {{-0.1f, 0.15f, 0.1f}, {-0.1f, 0.2f, -0.1f}}},
  };
  return all;
}

}  // namespace gs
