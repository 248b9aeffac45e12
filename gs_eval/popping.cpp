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

constexpr std::size_t kPlaces = 10;
constexpr int kOversampling = 2;
constexpr float kStep = 0.0174533f, kFar = 7;  // a degree a frame; frames

/// Writes the color that a frame shows along a ray in world coordinates, and returns whether it does.
bool look_up(const FilmFrame& frame, const Vec3f& ray, float* color) {
  const Vec3f p = multiply(frame.camera.cam_from_world_rotation, ray);
  if (!(p.z > 0)) return false;
  const Vec2f at = project_mean(frame.camera, p) - Vec2f(0.5f);
  const float left = std::floor(at.x), top = std::floor(at.y);
  if (!(left >= 0 && top >= 0 && left + 1 < float(frame.color.width) &&
        top + 1 < float(frame.color.height)))
    return false;
  for (int c = 0; c < 3; ++c) color[c] = 0;
  for (int k = 0; k < 4; ++k) {
    const int x = int(left) + k % 2, y = int(top) + k / 2;
    const float weight = (1 - std::abs(at.x - float(x))) * (1 - std::abs(at.y - float(y)));
    for (int c = 0; c < 3; ++c) color[c] += weight * frame.color.at(x, y, c);
  }
  return true;
}

/// The camera, turned to the right about its own vertical axis.
Camera turned(Camera camera, float angle) {
  const float c = std::cos(angle), s = std::sin(angle);
  const Mat3<float> W = camera.cam_from_world_rotation;
  const Vec3f t = camera.cam_from_world_translation;
  camera.cam_from_world_rotation = {W.row0 * c - W.row2 * s, W.row1, W.row0 * s + W.row2 * c};
  camera.cam_from_world_translation = {c * t.x - s * t.z, t.y, s * t.x + c * t.z};
  return camera;
}

}  // namespace

double flip_of_turned(const FilmFrame& frame, const FilmFrame& other) {
  GS_CHECK(other.color.width == frame.color.width && other.color.height == frame.color.height);
  const int width = frame.color.width / kOversampling, height = frame.color.height / kOversampling;
  ComparedPictures pair{ImageF(width, height, 3), ImageF(width, height, 3),
                        ImageF(width, height, 1)};
  std::vector<std::size_t> seen(height);
  const Camera& camera = frame.camera;
  parallel_for(std::size_t(height), 1, [&](std::size_t row) {
    const int y = int(row);
    for (int x = 0; x < width; ++x) {
      Vec3f here(0), there(0);
      bool is_seen = true;
      for (int k = 0; k < kOversampling * kOversampling && is_seen; ++k) {
        const int u = x * kOversampling + k % kOversampling,
                  v = y * kOversampling + k / kOversampling;
        const Vec3f ray{(float(u) + 0.5f - camera.cx) / camera.fx,
                        (float(v) + 0.5f - camera.cy) / camera.fy, 1};
        float color[3];
        is_seen = look_up(other, multiply_transposed(camera.cam_from_world_rotation, ray), color);
        for (int c = 0; c < 3 && is_seen; ++c) {
          here[c] += frame.color.at(u, v, c) / (kOversampling * kOversampling);
          there[c] += color[c] / (kOversampling * kOversampling);
        }
      }
      if (!is_seen) continue;
      ++seen[row];
      pair.weight.at(x, y, 0) = 1;
      for (int c = 0; c < 3; ++c) {
        pair.render.at(x, y, c) = here[c];
        pair.photo.at(x, y, c) = there[c];
      }
    }
  });
  std::size_t all = 0;
  for (const std::size_t count : seen) all += count;
  return all > 0 ? flip(pair) : 0;
}

Popping measure_popping(const std::vector<Camera>& cameras,
                        const std::function<ImageF(const Camera&)>& draw) {
  GS_CHECK(!cameras.empty());
  const std::vector<std::size_t> places = evenly_chosen(cameras.size(), kPlaces);
  Popping sum;
  for (const std::size_t i : places) {
    const Camera large =
        resized(cameras[i], kOversampling * cameras[i].width, kOversampling * cameras[i].height);
    const auto frame_at = [&](float steps) {
      const Camera camera = turned(large, steps * kStep);
      return FilmFrame{camera, draw(camera)};
    };
    const FilmFrame frame = frame_at(0);
    sum.next += flip_of_turned(frame, frame_at(1));
    sum.seventh += flip_of_turned(frame, frame_at(kFar));
  }
  return {sum.next / double(places.size()), sum.seventh / double(places.size())};
}

}  // namespace gs
