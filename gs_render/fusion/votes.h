// SPDX-License-Identifier: Apache-2.0
// What one voxel hears from all views: one formula for every device.
#pragma once

#include <limits>

#include "gs_render/fusion/depth_picture.h"
#include "gs_render/fusion/volume.h"

namespace gs {

/// The votes of views about a voxel, added in the order of the views; Fusion has the equations.
struct Votes {
  float sum = 0, weight = 0;
  int near = 0, free = 0, hidden = 0;  // views

  GS_HD void add(const DepthPicture& view, const Vec3f& p, float truncation) {
    const Vec3f c = to_camera(view.camera, p);
    Vec2f at;
    if (!view.contains(c, at)) return;
    const float o = view.inverse_depth_at(at);
    if (o < 0) ++free;
    if (!(o > 0)) return;
    const float facing = view.facing_at(int(at.x), int(at.y));
    const float d = (1 / o - c.z) * facing * length(c) / c.z;
    if (d <= -truncation) {
      ++hidden;
      return;
    }
    if (d > truncation)
      ++free;
    else
      ++near;
    const float share = min_of(d / truncation, 1.0f);
    const float g = facing * facing * o * o * min_of(1 + share, 1.0f);
    sum += g * share;
    weight += g;
  }
  /// The voxel's distance. `least`: views that must agree.
  GS_HD float distance(int least, bool is_watertight) const {
    // Of a closed surface, views before which a voxel is hidden, for each one that sees it: fewer
    // are rays that slip through gaps, and would dig tunnels.
    constexpr int kHiddenPerView = 8;
    if (is_watertight) least = max_of(least, hidden / kHiddenPerView);
    if (near + free < least) {
      if (!is_watertight) return std::numeric_limits<float>::quiet_NaN();
      return hidden > 0 ? -1.0f : 1.0f;
    }
    if (!(weight > 0) || free >= 3 + 3 * near) return 1;
    return sum / weight;
  }
};

/// Whether a view's pyramid may meet a block, whose first voxel is at `low`.
GS_HD bool sees_block(const Camera& camera, const VolumeFrame& frame, const Vec3f& low) {
  using std::sqrt;
  const float half = 0.5f * float(kBlockEdge - 1) * frame.voxel;
  const float radius = half * sqrt(3.0f);
  const Vec3f c = to_camera(camera, low + Vec3f(half));
  const auto is_inside = [&](float x, float f, float edge) {  // f x + edge z >= 0 inside
    return f * x + edge * c.z >= -radius * sqrt(f * f + edge * edge);
  };
  return c.z > -radius && is_inside(c.x, camera.fx, camera.cx) &&
         is_inside(-c.x, camera.fx, float(camera.width) - camera.cx) &&
         is_inside(c.y, camera.fy, camera.cy) &&
         is_inside(-c.y, camera.fy, float(camera.height) - camera.cy);
}

/// Calls visit(x, y, z) for the blocks that the surface at a point p meets within the truncation.
/// They are not the outermost ones.
template <class Visit>
GS_HD void for_blocks_near(const VolumeFrame& frame, const FusionRule& rule, const Vec3f& p,
                           Visit&& visit) {
  using std::floor;
  const float reach = rule.truncation / kBlockEdge;  // blocks
  const Vec3f at = (p - frame.low) / (kBlockEdge * frame.voxel);
  std::int64_t first[3], last[3];
  for (int axis = 0; axis < 3; ++axis) {
    first[axis] = max_of(std::int64_t(1), std::int64_t(floor(at[axis] - reach)));
    last[axis] =
        min_of(std::int64_t(frame.blocks[axis]) - 2, std::int64_t(floor(at[axis] + reach)));
  }
  for (std::int64_t z = first[2]; z <= last[2]; ++z)
    for (std::int64_t y = first[1]; y <= last[1]; ++y)
      for (std::int64_t x = first[0]; x <= last[0]; ++x)
        visit(std::uint64_t(x), std::uint64_t(y), std::uint64_t(z));
}

}  // namespace gs
