// SPDX-License-Identifier: Apache-2.0
#include "gs_render/panorama.h"

#include <algorithm>
#include <cmath>
#include <numbers>

#include "gs_core/math/lens/lens_projection.h"
#include "gs_core/threads/parallel.h"

namespace gs {
namespace {

using std::numbers::pi;

constexpr double kFiner = 1.5;  // pixels of a fisheye for one of the panorama: it stays sharp

/// Adds `weight` times the value between pixels to `out`, one number for each channel; of the
/// nearest pixel unless it `is_smooth`.
void add_sample(const ImageF& image, Vec2f at, bool is_smooth, float weight, float* out) {
  at.x = std::clamp(at.x - 0.5f, 0.0f, float(image.width - 1));
  at.y = std::clamp(at.y - 0.5f, 0.0f, float(image.height - 1));
  if (!is_smooth) at = {std::round(at.x), std::round(at.y)};
  const int x = std::min(int(at.x), std::max(image.width - 2, 0));
  const int y = std::min(int(at.y), std::max(image.height - 2, 0));
  const float s = at.x - float(x), t = at.y - float(y);
  const int right = std::min(x + 1, image.width - 1), below = std::min(y + 1, image.height - 1);
  for (int c = 0; c < image.channels; ++c)
    out[c] += weight * ((1 - t) * ((1 - s) * image.at(x, y, c) + s * image.at(right, y, c)) +
                        t * ((1 - s) * image.at(x, below, c) + s * image.at(right, below, c)));
}

}  // namespace

std::array<Camera, 2> panorama_halves(const Camera& panorama) {
  Camera front = panorama;
  const double focal_length = int(kFiner * panorama.width) / (2 * pi);
  front.fx = front.fy = float(focal_length);
  front.cx = front.cy = float(kHemisphereReach * focal_length);
  front.width = front.height = int(std::ceil(2 * kHemisphereReach * focal_length));
  front.lens = endless_lens<float>(Lens::fisheye);
  front.lens.radius = float(kHemisphereReach);
  Camera back = front;  // half a turn around y
  for (float* axis : {&back.cam_from_world_translation.x, &back.cam_from_world_translation.z})
    *axis = -*axis;
  back.cam_from_world_rotation.row0 = -back.cam_from_world_rotation.row0;
  back.cam_from_world_rotation.row2 = -back.cam_from_world_rotation.row2;
  return {front, back};
}

ImageF joined_panorama(const Camera& panorama, const std::array<ImageF, 2>& halves,
                       bool is_smooth) {
  const std::array<Camera, 2> cameras = panorama_halves(panorama);
  constexpr double kOverlap = 2 * (kHemisphereReach - pi / 2);
  ImageF result(panorama.width, panorama.height, halves[0].channels);
  parallel_for(std::size_t(panorama.height), 4, [&](std::size_t y) {
    const double down = ((double(y) + 0.5) / panorama.height - 0.5) * pi;
    for (int x = 0; x < panorama.width; ++x) {
      const double east = ((x + 0.5) / panorama.width - 0.5) * 2 * pi;
      const Vec3d ray(std::cos(down) * std::sin(east), std::sin(down),
                      std::cos(down) * std::cos(east));
      double share = std::clamp((kHemisphereReach - std::acos(ray.z)) / kOverlap, 0.0, 1.0);
      if (!is_smooth) share = std::round(share);
      for (const bool is_back : {false, true}) {
        const float weight = float(is_back ? 1 - share : share), side = is_back ? -1 : 1;
        if (weight == 0) continue;
        const Vec3f p(side * float(ray.x), float(ray.y), side * float(ray.z));
        const Vec2f at = project_through_lens(cameras[is_back], p).mean2d;
        add_sample(halves[is_back], at, is_smooth, weight, &result.at(x, int(y), 0));
      }
    }
  });
  return result;
}

}  // namespace gs
