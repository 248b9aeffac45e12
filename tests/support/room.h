// SPDX-License-Identifier: Apache-2.0
// A room of six walls in different colors, and its photos as panoramas of 360 degrees.
#pragma once

#include <cmath>
#include <numbers>

#include "data_loaders/colmap/colmap_model.h"
#include "gs_core/image.h"
#include "gs_core/math/render/rotation.h"

namespace gs {

inline constexpr double kRoomHalf[3] = {2, 1.2, 1.6};  // of its sides; the origin is its center

/// The color of the wall that a ray from inside hits, 0..1, and where that is. Each wall has a
/// color of its own and soft checkers of half a unit.
inline Vec3d room_color(const Vec3d& from, const Vec3d& direction, Vec3d* hit = nullptr) {
  double nearest = 1e9;
  int wall = 0;
  for (int axis = 0; axis < 3; ++axis) {
    if (direction[axis] == 0) continue;
    const bool is_far = direction[axis] > 0;
    const double at = ((is_far ? 1 : -1) * kRoomHalf[axis] - from[axis]) / direction[axis];
    if (at < nearest) nearest = at, wall = 2 * axis + is_far;
  }
  const Vec3d p = from + nearest * direction;
  if (hit) *hit = p;
  constexpr double kColors[6][3] = {{0.8, 0.3, 0.3}, {0.3, 0.7, 0.4}, {0.8, 0.8, 0.7},
                                    {0.5, 0.4, 0.3}, {0.3, 0.4, 0.8}, {0.8, 0.7, 0.2}};
  const double u = p[(wall / 2 + 1) % 3], v = p[(wall / 2 + 2) % 3];
  const double light =
      0.75 + 0.25 * std::sin(2 * std::numbers::pi * u) * std::sin(2 * std::numbers::pi * v);
  const double* color = kColors[wall];
  return {light * color[0], light * color[1], light * color[2]};
}

/// The direction of a panorama's pixel (hemispheres.h), in the frame of its camera.
inline Vec3d panorama_ray(double x, double y, int width, int height) {
  const double east = (x / width - 0.5) * 2 * std::numbers::pi;
  const double down = (y / height - 0.5) * std::numbers::pi;
  return {std::cos(down) * std::sin(east), std::sin(down), std::cos(down) * std::cos(east)};
}

/// A picture of directions: `color(ray)` at the center of each pixel.
template <class Color>
Image8 panorama_of(int width, const Color& color) {
  ImageF image(width, width / 2, 3);
  for (int y = 0; y < image.height; ++y)
    for (int x = 0; x < width; ++x) {
      const Vec3d at = color(panorama_ray(x + 0.5, y + 0.5, width, image.height));
      for (int c = 0; c < 3; ++c) image.at(x, y, c) = float(at[c]);
    }
  return to_image8(image);
}

/// Adds level photos by camera 1 from a ring of this reach about the origin, which look in all
/// directions of the horizon: a.png, b.png and so on.
inline void add_ring(ColmapModel& model, std::size_t photos, const Vec3d& reach) {
  for (std::size_t i = 0; i < photos; ++i) {
    const double turn = 2.4 * double(i), place = 0.7 * double(i);
    const Quat<double> q{std::cos(turn / 2), 0, std::sin(turn / 2), 0};
    const Vec3d center(reach.x * std::cos(place), reach.y * std::sin(1.7 * double(i)),
                       reach.z * std::sin(place));
    model.images.push_back({std::uint32_t(i + 1), std::string(1, char('a' + i)) + ".png", 1, q,
                            -multiply(rotation_matrix(q), center)});
  }
}

/// A COLMAP model of panoramas around the room's center, held level and turned in all directions,
/// with points on its walls.
inline ColmapModel room_model(std::size_t photos, int width, std::uint64_t points = 400) {
  ColmapModel model;
  model.cameras[1] = {
      1, CameraModel::equirectangular, width, width / 2, {double(width), double(width / 2)}};
  add_ring(model, photos, {0.8, 0.3, 0.6});
  for (std::uint64_t i = 0; i < points; ++i) {  // a spiral around the center
    const double down = 1 - 2 * (double(i) + 0.5) / double(points), r = std::sqrt(1 - down * down);
    const Vec3d ray(r * std::cos(2.39996 * double(i)), down, r * std::sin(2.39996 * double(i)));
    ColmapPoint point{i + 1};
    const Vec3d color = room_color(Vec3d(0.0), ray, &point.position);
    for (int c = 0; c < 3; ++c) point.color[c] = std::uint8_t(255 * color[c]);
    model.points.push_back(point);
  }
  return model;
}

/// The panorama of one image of a room_model().
inline Image8 room_photo(const ColmapImage& image, int width) {
  const Mat3<double> R = rotation_matrix(image.cam_from_world_rotation);
  const Vec3d center = -multiply_transposed(R, image.cam_from_world_translation);
  return panorama_of(
      width, [&](const Vec3d& ray) { return room_color(center, multiply_transposed(R, ray)); });
}

}  // namespace gs
