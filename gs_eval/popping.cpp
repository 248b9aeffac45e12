// SPDX-License-Identifier: Apache-2.0
#include "gs_eval/popping.h"

#include <cmath>

#include "gs_core/error.h"
#include "gs_core/evenly_chosen.h"
#include "gs_core/math/render/projection.h"
#include "gs_core/threads/parallel.h"
#include "gs_eval/flip/flip.h"

namespace gs {
namespace {

constexpr std::size_t kPlaces = 10, kFar = 7;  // frames
constexpr float kSameSurface = 0.01f;          // of a depth

/// The point that a pixel shows, in world coordinates.
Vec3f point_at(const FilmFrame& frame, int x, int y) {
  const Camera& camera = frame.camera;
  const float z = frame.depth.at(x, y, 0);
  const Vec3f p{(float(x) + 0.5f - camera.cx) / camera.fx * z,
                (float(y) + 0.5f - camera.cy) / camera.fy * z, z};
  return multiply_transposed(camera.cam_from_world_rotation, p - camera.cam_from_world_translation);
}

/// Writes what the other frame shows of a point, if it does, and returns whether it does.
bool see(const FilmFrame& other, const Vec3f& point, float* color) {
  const Vec3f p = to_camera(other.camera, point);
  if (!(p.z > 0)) return false;
  const Vec2f at = project_mean(other.camera, p) - Vec2f(0.5f);
  const float left = std::floor(at.x), top = std::floor(at.y);
  if (!(left >= 0 && top >= 0 && left + 1 < float(other.color.width) &&
        top + 1 < float(other.color.height)))
    return false;
  for (int c = 0; c < 3; ++c) color[c] = 0;
  for (int k = 0; k < 4; ++k) {
    const int x = int(left) + k % 2, y = int(top) + k / 2;
    if (!(std::abs(other.depth.at(x, y, 0) - p.z) <= kSameSurface * p.z)) return false;
    const float weight = (1 - std::abs(at.x - float(x))) * (1 - std::abs(at.y - float(y)));
    for (int c = 0; c < 3; ++c) color[c] += weight * other.color.at(x, y, c);
  }
  return true;
}

}  // namespace

double flip_of_neighbor(const FilmFrame& frame, const FilmFrame& other) {
  const int width = frame.color.width, height = frame.color.height;
  GS_CHECK(other.color.width == width && other.color.height == height);
  ComparedPictures pair{ImageF(width, height, 3), ImageF(width, height, 3),
                        ImageF(width, height, 1)};
  std::vector<std::size_t> seen(height);
  parallel_for(std::size_t(height), 1, [&](std::size_t row) {
    const int y = int(row);
    for (int x = 0; x < width; ++x) {
      float color[3];
      if (!(frame.depth.at(x, y, 0) > 0) || !see(other, point_at(frame, x, y), color)) continue;
      ++seen[row];
      pair.weight.at(x, y, 0) = 1;
      for (int c = 0; c < 3; ++c) {
        pair.render.at(x, y, c) = frame.color.at(x, y, c);
        pair.photo.at(x, y, c) = color[c];
      }
    }
  });
  std::size_t all = 0;
  for (const std::size_t count : seen) all += count;
  return all > 0 ? flip(pair) : 0;
}

Popping measure_popping(const std::vector<Camera>& film,
                        const std::function<FilmFrame(const Camera&)>& draw) {
  GS_CHECK(film.size() > kFar);
  const std::vector<std::size_t> places = evenly_chosen(film.size() - kFar, kPlaces);
  Popping sum;
  for (const std::size_t i : places) {
    const FilmFrame frame = draw(film[i]);
    sum.next += flip_of_neighbor(frame, draw(film[i + 1]));
    sum.seventh += flip_of_neighbor(frame, draw(film[i + kFar]));
  }
  return {sum.next / double(places.size()), sum.seventh / double(places.size())};
}

}  // namespace gs
