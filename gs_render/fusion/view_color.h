// SPDX-License-Identifier: Apache-2.0
// The color of a point of a surface in the views that see it best.
#pragma once

#include <algorithm>
#include <array>
#include <cmath>
#include <optional>
#include <utility>
#include <vector>

#include "gs_render/between_pixels.h"
#include "gs_render/fusion/depth_view.h"

namespace gs {

/// One view's say about the color of a point.
struct ColorSample {
  float weight = 0;
  const DepthView* view = nullptr;
  Vec2f at{0};  // pixels

  /// 0 to 255.
  Vec3f color() const { return between_pixels(view->color, at); }
};

inline ColorSample sample_of(const DepthView& view, const Vec3f& p, float voxel) {
  constexpr float kVisibleVoxels = 2;  // depth between a point and what its pixel shows
  const DepthPicture picture = view.picture();
  const Vec3f c = to_camera(view.camera, p);
  Vec2f at;
  if (!picture.contains(c, at)) return {};
  const float o = picture.inverse_depth_at(at);
  if (!(o > 0) || std::abs(1 / o - c.z) > kVisibleVoxels * voxel) return {};
  const float facing = picture.facing_at(int(at.x), int(at.y));
  return {facing * facing * o * o, &view, at};
}

/// The mean over the four views that see a point best, 0 to 255 in display sRGB, weighted by
/// cos^2 o^2; none where no view sees it.
inline std::optional<Vec3f> view_color(const std::vector<DepthView>& views, const Vec3f& p,
                                       float voxel) {
  std::array<ColorSample, 4> best;  // the best one first
  for (const DepthView& view : views) {
    ColorSample sample = sample_of(view, p, voxel);
    for (ColorSample& other : best)
      if (sample.weight > other.weight) std::swap(sample, other);
  }
  if (!(best[0].weight > 0)) return {};
  Vec3f sum(0);
  float weights = 0;
  for (const ColorSample& sample : best) {
    if (!sample.view) break;
    sum += sample.weight * sample.color();
    weights += sample.weight;
  }
  return sum / weights;
}

inline std::uint8_t byte_of(float value) {
  return std::uint8_t(std::clamp(value, 0.0f, 255.0f) + 0.5f);
}

}  // namespace gs
