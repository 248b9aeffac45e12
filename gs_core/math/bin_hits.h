// SPDX-License-Identifier: Apache-2.0
// Lists by bins: which bins of 32 or 64 pixels a splat hits, and which sub-tiles of 8 x 8 pixels
// within a bin. Both follow from the hit tiles, so that lists by bins and by tiles agree.
#pragma once

#include "gs_core/math/tile_bounds.h"
#include "gs_core/math/view_splat.h"

namespace gs {

inline constexpr int kSubtileSide = 8;  // pixels; a tile has four of them, its quarters
static_assert(kTileWidth == 2 * kSubtileSide && kTileHeight == 2 * kSubtileSide);

/// Which of a bin's sub-tiles a splat hits, bit by bit in row order. A bin of 64 pixels has 64.
using SubtileBits = std::uint64_t;

/// Columns [begin, end) of bins.
struct BinSpan {
  int begin, end;
};

/// The bins of a row of bins that hold hit tiles, from the first to the last one. An ellipse is
/// convex, so that a bin between them without a hit tile is rare.
///
/// bounds    which tiles list a splat
/// pixels    the splat's bounding rectangle
/// bin_side  32 or 64 pixels
GS_HD BinSpan hit_bins_of_row(TileBounds bounds, const SplatOutline& splat, const Rect& pixels,
                              int bin_y, int bin_side) {
  const Rect tiles = tile_rect(pixels);
  const int per_bin = bin_side / kTileHeight;
  const int first = max_of(int(tiles.y_begin), bin_y * per_bin),
            end = min_of(int(tiles.y_end), (bin_y + 1) * per_bin);
  int left = tiles.x_end, right = 0;
  for (int y = first; y < end; ++y) {
    const TileSpan span =
        hit_tiles_of_row(splat.mean2d, splat.conic, tile_cutoff(bounds, splat.cutoff), tiles, y);
    if (span.begin >= span.end) continue;
    left = min_of(left, span.begin);
    right = max_of(right, span.end);
  }
  if (left >= right) return {0, 0};
  return {left / per_bin, (right + per_bin - 1) / per_bin};
}

/// The sub-tiles of a bin that a splat hits: the quarters of hit tiles that hit_quarters_of_row()
/// does not rule out. Arguments as above.
template <class Arithmetic = ExactArithmetic>
GS_HD SubtileBits subtile_bits(TileBounds bounds, const SplatOutline& splat, const Rect& pixels,
                               int bin_x, int bin_y, int bin_side) {
  const Rect tiles = tile_rect(pixels);
  const int per_bin = bin_side / kTileHeight, per_row = bin_side / kSubtileSide;
  SubtileBits bits = 0;
  for (int tile_row = 0; tile_row < per_bin; ++tile_row) {
    const int y = bin_y * per_bin + tile_row;
    if (y < tiles.y_begin || y >= tiles.y_end) continue;
    const TileSpan span =
        hit_tiles_of_row(splat.mean2d, splat.conic, tile_cutoff(bounds, splat.cutoff), tiles, y);
    const QuarterSpans quarters =
        hit_quarters_of_row<Arithmetic>(splat.mean2d, splat.conic, splat.cutoff, y);
    for (int half = 0; half < 2; ++half) {
      const int first = max_of(max_of(int(quarters.begin[half]), 2 * span.begin), bin_x * per_row);
      const int end = min_of(min_of(int(quarters.end[half]), 2 * span.end), (bin_x + 1) * per_row);
      if (first >= end) continue;
      const SubtileBits columns = ((1u << (end - first)) - 1u) << (first - bin_x * per_row);
      bits |= columns << ((2 * tile_row + half) * per_row);
    }
  }
  return bits;
}

}  // namespace gs
