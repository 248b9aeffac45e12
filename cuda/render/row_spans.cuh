// SPDX-License-Identifier: Apache-2.0
// The tiles that splats hit, as spans of tile rows. A row is the unit of work that the lanes of a
// warp share evenly, both when tiles are counted (preprocess.cu) and when instances are written
// (instances.cu). Both call hit_tiles_of_row(), and both files are compiled without contraction of
// products and sums, so that their results are the same.
#pragma once

#include "cuda/device/warp.cuh"
#include "gs_core/math/view/view_splat.h"

namespace gs::cuda {

/// 32 owners have consecutive items; returns the owner of `item`. first[k] is the first item of
/// owner k. An owner without items has the first item of the next owner.
__device__ inline int owner_of(std::uint32_t item, const std::uint32_t* first) {
  int owner = 0;
#pragma unroll
  for (int step = kWarp / 2; step > 0; step /= 2)
    if (first[owner + step] <= item) owner += step;
  return owner;
}

// Fast division and root, for the parts of a tile: their slack is far above the errors.
struct FastArithmetic {
  __device__ static float quotient(float a, float b) { return __fdividef(a, b); }
  __device__ static float root(float x) { return x * rsqrtf(fmaxf(x, 1e-30f)); }
};

/// The tile rows of a warp's 32 splats, numbered consecutively. In shared memory.
template <int edge = kTileWidth>
struct TileRows {
  Vec2f mean2d[kWarp];
  Sym2<float> conic[kWarp];
  float cutoff[kWarp], cutoff_of_tiles[kWarp];
  Rect tiles[kWarp];
  std::uint32_t first[kWarp];  // number of the splat's first row

  /// The whole warp: takes each lane's splat, or none where `pixels` is empty, and returns the
  /// number of rows.
  __device__ std::uint32_t take(const SplatOutline& splat, const Rect& pixels, TileBounds bounds) {
    const int lane = lane_of_thread();
    const Rect rect = tile_rect<edge>(pixels);
    const std::uint32_t rows = pixels.empty() ? 0 : rect.y_end - rect.y_begin;
    const std::uint32_t before = warp_exclusive_sum(rows);
    mean2d[lane] = splat.mean2d;
    conic[lane] = splat.conic;
    cutoff[lane] = splat.cutoff;
    cutoff_of_tiles[lane] = tile_cutoff(bounds, splat.cutoff);
    tiles[lane] = rect;
    first[lane] = before;
    __syncwarp();
    return __shfl_sync(kAllLanes, before + rows, kWarp - 1);
  }
  __device__ int tile_y(std::uint32_t row, int owner) const {
    return int(tiles[owner].y_begin + (row - first[owner]));
  }
  __device__ PartSpans<edge> parts(std::uint32_t row, int owner) const {
    return hit_parts_of_row<edge, FastArithmetic>(mean2d[owner], conic[owner], cutoff[owner],
                                                  tile_y(row, owner));
  }
  __device__ TileSpan span(std::uint32_t row, int owner) const {
    return hit_tiles_of_row<edge>(mean2d[owner], conic[owner], cutoff_of_tiles[owner], tiles[owner],
                                  tile_y(row, owner));
  }
};

}  // namespace gs::cuda
