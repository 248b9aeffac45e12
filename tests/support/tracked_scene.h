// SPDX-License-Identifier: Apache-2.0
// COLMAP models with known true values: cameras on an arc around a cloud of points, which they
// observe exactly.
#pragma once

#include <cmath>
#include <string>
#include <vector>

#include "data_loaders/colmap/colmap_model.h"
#include "gs_core/math/random.h"
#include "gs_core/math/render/rotation.h"
#include "tests/data_loaders/photos/lens_cases.h"

namespace gs {

/// Where a point in camera space projects to: projected() of lens_cases.h, and the pinholes.
inline Vec2d landing(const ColmapCamera& camera, const Vec3d& at) {
  const std::vector<double>& p = camera.params;
  if (camera.model == CameraModel::simple_pinhole)
    return {p[0] * at.x / at.z + p[1], p[0] * at.y / at.z + p[2]};
  if (camera.model == CameraModel::pinhole)
    return {p[0] * at.x / at.z + p[2], p[1] * at.y / at.z + p[3]};
  return projected(camera, at.x, at.y, at.z);
}

inline Vec3d in_camera(const ColmapImage& image, const Vec3d& point) {
  return multiply(rotation_matrix(image.cam_from_world_rotation), point) +
         image.cam_from_world_translation;
}
inline Vec3d center_of(const ColmapImage& image) {
  return -multiply_transposed(rotation_matrix(image.cam_from_world_rotation),
                              image.cam_from_world_translation);
}

/// The angle between two poses in degrees.
inline double turn_between(const ColmapImage& a, const ColmapImage& b) {
  const Quat<double>&p = a.cam_from_world_rotation, &q = b.cam_from_world_rotation;
  const double dot = std::abs(p.w * q.w + p.x * q.x + p.y * q.y + p.z * q.z);
  return 2 * std::acos(std::min(dot, 1.0)) * 180 / 3.141592653589793;
}

/// An image that stands at `center` and is turned by `angle` (radians) about the vertical axis, y.
inline ColmapImage posed_image(std::uint32_t id, std::uint32_t camera, const Vec3d& center,
                               double angle) {
  ColmapImage image{id,
                    "photo_" + std::to_string(100 + id) + ".png",
                    camera,
                    {std::cos(angle / 2), 0, std::sin(angle / 2), 0},
                    {}};
  image.cam_from_world_translation =
      -multiply(rotation_matrix(image.cam_from_world_rotation), center);
  return image;
}

/// Fills in the observations of each image: all points that project into its picture.
inline void observe(ColmapModel& model) {
  for (ColmapImage& image : model.images) {
    const ColmapCamera& camera = model.cameras.at(image.camera_id);
    image.observations.clear();
    for (const ColmapPoint& point : model.points) {
      const Vec3d at = in_camera(image, point.position);
      if (at.z < 0.1) continue;
      const Vec2d pixel = landing(camera, at);
      if (pixel.x > 0 && pixel.y > 0 && pixel.x < camera.width && pixel.y < camera.height)
        image.observations.push_back({point.id, pixel.x, pixel.y});
    }
  }
}

/// `images` cameras at distance 4 from the origin, spread over 100 degrees, and `points` points in
/// a cube of side 2.
inline ColmapModel tracked_model(const ColmapCamera& camera, int images, int points) {
  const Random random{5, RandomStream::test};
  ColmapModel model;
  model.cameras[camera.id] = camera;
  for (int i = 0; i < points; ++i) {
    const Vec4f u = random.uniform4(std::uint64_t(i));
    model.points.push_back(
        {std::uint64_t(i + 1), {2.0 * u.x - 1, 2.0 * u.y - 1, 2.0 * u.z - 1}, {90, 90, 90}});
  }
  for (int i = 0; i < images; ++i) {
    const double angle = 1.75 * (double(i) / (images - 1) - 0.5);
    const Vec3d center(4 * std::sin(angle), 0.8 * std::sin(3.0 * i), -4 * std::cos(angle));
    model.images.push_back(posed_image(std::uint32_t(i + 1), camera.id, center, angle));
  }
  observe(model);
  return model;
}

/// Adds normal noise to poses, points and lens parameters: `pose` radians and world units to poses,
/// `point` world units to points, and the fraction `focal` to focal lengths.
struct Disturbance {
  double pose = 0.01, point = 0.02, focal = 0.01;
};
inline void disturb(ColmapModel& model, const Disturbance& by) {
  const Random random{6, RandomStream::test};
  std::uint64_t next = 0;
  const auto noise = [&](double size) {
    const Vec4f n = random.normal4(next++);
    return Vec3d(n.x, n.y, n.z) * size;
  };
  for (ColmapImage& image : model.images) {
    const Vec3d turn = noise(by.pose / 2), shift = noise(by.pose);
    const Quat<double> q = image.cam_from_world_rotation;
    Quat<double>& r = image.cam_from_world_rotation;
    r = {q.w - turn.x * q.x - turn.y * q.y - turn.z * q.z,
         q.x + turn.x * q.w + turn.y * q.z - turn.z * q.y,
         q.y - turn.x * q.z + turn.y * q.w + turn.z * q.x,
         q.z + turn.x * q.y - turn.y * q.x + turn.z * q.w};
    const double n = 1 / std::sqrt(squared_norm(r));
    r = {n * r.w, n * r.x, n * r.y, n * r.z};
    image.cam_from_world_translation += shift;
  }
  for (ColmapPoint& point : model.points) point.position += noise(by.point);
  for (auto& [id, camera] : model.cameras) {
    const bool one_focal = camera.model == CameraModel::simple_pinhole ||
                           camera.params.size() % 2 == 1 ||
                           camera.params[1] < 0.7 * camera.params[0];
    camera.params[0] *= 1 + by.focal;
    if (!one_focal) camera.params[1] *= 1 + by.focal;
  }
}

}  // namespace gs
