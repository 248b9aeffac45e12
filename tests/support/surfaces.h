// SPDX-License-Identifier: Apache-2.0
// Things with a known surface, and cameras all around them.
#pragma once

#include <cmath>
#include <limits>
#include <vector>

#include "gs_core/geometry/vectors.h"
#include "gs_render/fusion/depth_view.h"
#include "tests/support/scenes.h"

namespace gs {

inline constexpr int kPictureSide = 96;  // pixels
inline constexpr float kDistance = 3;    // of cameras from the origin
inline const float kFar = std::numeric_limits<float>::infinity();

/// Directions that are spread evenly over the sphere.
inline std::vector<Vec3f> directions(int count) {
  std::vector<Vec3f> all;
  for (int i = 0; i < count; ++i) {
    const float y = 1 - (2 * float(i) + 1) / float(count), turn = 2.39996323f * float(i);
    const float r = std::sqrt(1 - y * y);
    all.emplace_back(r * std::cos(turn), y, r * std::sin(turn));
  }
  return all;
}

/// A camera in this direction from the origin, which it looks at.
inline Camera camera_from(const Vec3f& direction) {
  Camera camera;
  camera.width = camera.height = kPictureSide;
  camera.fx = camera.fy = 110;
  camera.cx = camera.cy = kPictureSide / 2;
  const Vec3f z = -direction;
  const Vec3f x = unit(cross(std::abs(z.y) < 0.9f ? Vec3f(0, 1, 0) : Vec3f(1, 0, 0), z));
  camera.cam_from_world_rotation = {x, cross(z, x), z};
  camera.cam_from_world_translation = {0, 0, kDistance};
  return camera;
}

/// How far a ray goes from a point until it meets the thing; infinity where it does not.
using Trace = float (*)(const Vec3f& from, const Vec3f& ray);

inline float trace_sphere(const Vec3f& from, const Vec3f& ray) {
  const float a = inner(ray, ray), b = inner(from, ray), c = inner(from, from) - 1;
  const float root = b * b - a * c;
  return root > 0 ? (-b - std::sqrt(root)) / a : kFar;
}

/// What cameras in these directions see of a thing.
inline std::vector<DepthView> views_of(Trace trace, const std::vector<Vec3f>& from) {
  std::vector<DepthView> views;
  for (const Vec3f& direction : from) {
    const Camera camera = camera_from(direction);
    ImageF inverse(kPictureSide, kPictureSide, 1, kOpenPixel);
    for (int y = 0; y < kPictureSide; ++y)
      for (int x = 0; x < kPictureSide; ++x) {
        const Vec3f ray =
            behind_pixel(camera, float(x) + 0.5f, float(y) + 0.5f, 1) - camera.position();
        const float z = trace(camera.position(), ray);
        if (z < kFar) inverse.at(x, y, 0) = 1 / z;
      }
    views.push_back(depth_view(camera, inverse, Image8(kPictureSide, kPictureSide, 3, 77)));
  }
  return views;
}

/// Flat Gaussians on the unit sphere, and faint ones that float around it.
inline Gaussians sphere_of_gaussians() {
  const std::vector<Vec3f> on = directions(1500), off = directions(60);
  Gaussians all(on.size() + off.size(), host_memory());
  for (std::size_t i = 0; i < on.size(); ++i) {
    set_gaussian(all, i, on[i], 0.06f, 0.95f);
    all.log_scale[i].z = std::log(2e-3f);
    all.rotation[i] = {1 + on[i].z, -on[i].y, on[i].x, 0};  // z to the normal; any length
  }
  for (std::size_t i = 0; i < off.size(); ++i)
    set_gaussian(all, on.size() + i, 1.4f * off[i], 0.1f, 0.15f);
  return all;
}

}  // namespace gs
