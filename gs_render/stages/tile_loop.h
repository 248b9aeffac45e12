// SPDX-License-Identifier: Apache-2.0
// How the scalar blend stages go through a tile: its pixels, and those of them that a splat may
// touch.
#pragma once

#include <algorithm>

#include "gs_render/render_pass.h"

namespace gs {

inline constexpr int kTilePixels = kTileWidth * kTileHeight;
inline constexpr int kLanes = 8;  // pixels of a row that are computed together
// splats between checks whether the whole tile is opaque
inline constexpr int kClosedCheckInterval = 16;
static_assert(kTileWidth % kLanes == 0);

/// One tile of a pass: its place in the picture and its list of instances.
struct Tile {
  int x, y;                  // pixels, upper left corner
  std::uint32_t begin, end;  // range in tile_instances

  Tile(const RenderPass& pass, std::size_t index)
      : x(int(index % pass.tiles_x) * kTileWidth), y(int(index / pass.tiles_x) * kTileHeight),
        begin(pass.tile_ranges[index]), end(pass.tile_ranges[index + 1]) {}

  /// True where pixel number `pixel` of the tile, counted row by row, is inside the picture.
  bool contains(const RenderPass& pass, int pixel) const {
    return x + pixel % kTileWidth < pass.width && y + pixel / kTileWidth < pass.height;
  }
  std::size_t image_index(const RenderPass& pass, int pixel) const {
    return std::size_t(y + pixel / kTileWidth) * pass.width + (x + pixel % kTileWidth);
  }
};

/// The sum of one number per lane, always added up in the same order.
inline float sum_of_lanes(const float (&lanes)[kLanes]) {
  return ((lanes[0] + lanes[4]) + (lanes[2] + lanes[6])) +
         ((lanes[1] + lanes[5]) + (lanes[3] + lanes[7]));
}

/// Calls visit(first, dx, dy) for each group of kLanes pixels of the tile that intersects the
/// splat's rectangle. `first` is the group's first pixel in the tile, (dx, dy) its offset from the
/// splat's mean.
template <class Visit>
inline void for_each_lane_group(const Tile& tile, const Rect& rect, const Vec2f& mean2d,
                                Visit&& visit) {
  const int y_begin = std::max(int(rect.y_begin) - tile.y, 0);
  const int y_end = std::min(int(rect.y_end) - tile.y, kTileHeight);
  const int x_begin = std::max(int(rect.x_begin) - tile.x, 0) / kLanes * kLanes;
  const int x_end = std::min(int(rect.x_end) - tile.x, kTileWidth);
  for (int y = y_begin; y < y_end; ++y)
    for (int x = x_begin; x < x_end; x += kLanes)
      visit(y * kTileWidth + x, float(tile.x + x) + 0.5f - mean2d.x,
            float(tile.y + y) + 0.5f - mean2d.y);
}

}  // namespace gs
