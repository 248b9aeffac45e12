// SPDX-License-Identifier: Apache-2.0
// Whether views agree about a surface: one formula for every device.
#pragma once

#include "gs_core/buffer.h"
#include "gs_render/fusion/depth_picture.h"

namespace gs {

/// Whether another view shows the point p that a view has at a pixel: its own point there has the
/// same depth to 1 %, and lies in the same pixel of the view to one pixel.
GS_HD bool agrees(const DepthPicture& view, int x, int y, const Vec3f& p,
                  const DepthPicture& other) {
  using std::abs;
  constexpr float kSameDepth = 0.01f, kSamePixel = 1;  // of the depth; pixels
  const Vec3f c = to_camera(other.camera, p);
  Vec2f at;
  if (!other.contains(c, at)) return false;
  const float o = other.inverse_depth_at(at);
  if (!(o > 0) || abs(1 / o - c.z) > kSameDepth * c.z) return false;
  // The point on the other's ray at the other's depth
  const Vec3f there = multiply_transposed(other.camera.cam_from_world_rotation,
                                          c / (o * c.z) - other.camera.cam_from_world_translation);
  const Vec3f back = to_camera(view.camera, there);
  if (!(back.z > 0)) return false;
  const Vec2f pixel = project_mean(view.camera, back);
  const float dx = pixel.x - (float(x) + 0.5f), dy = pixel.y - (float(y) + 0.5f);
  return dx * dx + dy * dy < kSamePixel * kSamePixel;
}

/// Whether no other view agrees with a pixel that shows a surface.
GS_HD bool is_doubtful(Span<const DepthPicture> views, std::size_t view, int x, int y) {
  const DepthPicture& own = views[view];
  if (!own.has(x, y)) return false;
  const Vec3f p = own.world_point(x, y);
  for (std::size_t k = 1; k < views.size; ++k)  // neighbors by number agree more often
    if (agrees(own, x, y, p, views[(view + k) % views.size])) return false;
  return true;
}

}  // namespace gs
