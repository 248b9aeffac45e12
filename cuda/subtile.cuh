// SPDX-License-Identifier: Apache-2.0
// What both blend kernels share: a warp owns 8 x 4 pixels of a tile and walks the tile's list by itself, 32 splats
// at a time: each lane fetches one and tests it against the sub-tile; those that hit are listed in shared memory
// and then blended by all lanes, a pixel each. No block ever waits for another warp.
// Sub-tiles of a warp: Yang et al. 2026 (warp-level culling); the exact test: Radl et al. 2024.
#pragma once

#include "cuda/stages.cuh"
#include "cuda/warp.cuh"
#include "gs_core/math/blend.h"
#include "gs_core/math/splat.h"
#include "gs_render/render_pass.h"

namespace gs::cuda {

inline constexpr int kSubtileWidth = 8, kSubtileHeight = 4;  // pixels; a row of one is a sector of memory
static_assert(kSubtileWidth * kSubtileHeight == kWarp);
inline constexpr int kSubtilesPerRow = kTileWidth / kSubtileWidth;
inline constexpr int kSubtilesPerTile = kSubtilesPerRow * kTileHeight / kSubtileHeight;

inline constexpr int kBlendThreads = 128;  // four warps: half a tile, whose warps find each other's splats in L1
inline constexpr int kBlendWarps = kBlendThreads / kWarp;
static_assert(kSubtilesPerTile % kBlendWarps == 0);

// The sub-tile's test may not lose a fragment that the pixel's own test keeps: so much of the quadratic is
// granted to rounding, also that of needles, whose terms cancel.
inline constexpr float kSubtileSlack = 4e-6f;

/// A picture and its tiles' lists.
struct TileLists {
  int width, height, tiles_x;
  const std::uint32_t* ranges;  // (tiles + 1)
  const std::uint32_t* splats;  // (I) Gaussian of each place
  const Splat* of_gaussian;     // (N)
};
inline TileLists tile_lists(const RenderPass& pass) {
  return {pass.width,
          pass.height,
          pass.tiles_x,
          pass.tile_ranges.data(),
          pass.tile_splats.data(),
          pass.splats.data()};
}
/// Blocks of kBlendThreads that have a warp for each sub-tile of so many tiles, or segments.
inline std::size_t blend_blocks(std::size_t tiles) {
  return tiles * kSubtilesPerTile / kBlendWarps;
}

/// Which tile, or segment, and which of its sub-tiles this warp has.
struct WarpWork {
  std::uint32_t item;
  int subtile;

  __device__ WarpWork() {
    const std::uint32_t warp = blockIdx.x * kBlendWarps + threadIdx.x / kWarp;
    item = warp / kSubtilesPerTile;
    subtile = int(warp % kSubtilesPerTile);
  }
};

/// The sub-tile of this warp and the pixel of this lane.
struct Subtile {
  std::uint32_t tile;
  int number;      // within the tile, row by row
  int x0, y0;      // upper left pixel
  int x, y;        // this lane's pixel
  bool is_inside;  // the picture

  __device__ Subtile(const TileLists& lists, std::uint32_t tile, int number)
      : tile(tile), number(number) {
    const int lane = lane_of_thread();
    x0 = int(tile) % lists.tiles_x * kTileWidth + number % kSubtilesPerRow * kSubtileWidth;
    y0 = int(tile) / lists.tiles_x * kTileHeight + number / kSubtilesPerRow * kSubtileHeight;
    x = x0 + lane % kSubtileWidth;
    y = y0 + lane / kSubtileWidth;
    is_inside = x < lists.width && y < lists.height;
  }
  __device__ std::size_t pixel(const TileLists& lists) const {
    return std::size_t(y) * lists.width + x;
  }
  /// This lane's place among the pixels of a tile as checkpoints hold them.
  __device__ std::size_t checkpoint(std::uint32_t slot) const {
    return std::size_t(slot) * kTileWidth * kTileHeight + number * kWarp + lane_of_thread();
  }
};

/// A splat as the pixels of a sub-tile read it. Exponents are to base 2: e = xx dx^2 + xy dx dy + yy dy^2.
struct alignas(16) ListedSplat {
  Vec2f mean2d;
  float xx, xy;
  float yy, lowest;         // a fragment is kept iff e >= lowest
  float opacity, red;       // colours are not below 0
  float green, blue;
  std::uint32_t position;   // in the tile's list
  std::uint32_t gaussian;
};

__device__ inline ListedSplat listed(const Splat& splat, std::uint32_t position,
                                     std::uint32_t gaussian) {
  constexpr float kScale = float(kLog2E);
  return {splat.mean2d,
          -0.5f * kScale * splat.conic.xx,
          -kScale * splat.conic.xy,
          -0.5f * kScale * splat.conic.yy,
          -kScale * splat.cutoff,
          splat.opacity,
          max_of(splat.color.x, 0.0f),
          max_of(splat.color.y, 0.0f),
          max_of(splat.color.z, 0.0f),
          position,
          gaussian};
}

/// exp(E) of a fragment to base 2: the exponent e, never above 0. Forward and backward both ask here, so that
/// they keep the same fragments.
__device__ inline float base2_exponent(const ListedSplat& splat, float dx, float dy) {
  const float e = fmaf(dx, fmaf(splat.xx, dx, splat.xy * dy), splat.yy * dy * dy);
  return fminf(e, 0.0f);
}
__device__ inline float exp2_fragment(float e) { return exp2f(e); }

/// One warp's way through positions [first, last) of its tile's list: fetches 32 splats ahead.
class ListWalk {
 public:
  __device__ ListWalk(const TileLists& lists, const Subtile& subtile, std::uint32_t first,
                      std::uint32_t last)
      : lists_(lists), x_min_(float(subtile.x0) + 0.5f), y_min_(float(subtile.y0) + 0.5f),
        begin_(lists.ranges[subtile.tile]), end_(begin_ + last), next_(begin_ + first) {
    gaussian_ahead_ = gaussian_at(next_ + lane_of_thread());
    fetch();
  }
  __device__ bool is_done() const { return next_ >= end_; }
  /// Where the next splats stand in the list.
  __device__ std::uint32_t position() const { return next_ - begin_; }

  /// The whole warp: lists the splats of the next 32 that hit the sub-tile, and returns how many they are.
  __device__ int list_next(ListedSplat* list) {
    const std::uint32_t place = next_ + lane_of_thread(), gaussian = gaussian_;
    const Splat splat = splat_;
    next_ += kWarp;
    fetch();
    const bool hit = place < end_ && rectangle_is_hit(splat.mean2d, splat.conic, splat.cutoff,
                                                      x_min_, x_min_ + kSubtileWidth - 1, y_min_,
                                                      y_min_ + kSubtileHeight - 1, kSubtileSlack);
    const unsigned hits = __ballot_sync(kAllLanes, hit);
    if (hit) list[__popc(hits & lanes_below())] = listed(splat, place - begin_, gaussian);
    __syncwarp();
    return __popc(hits);
  }

 private:
  __device__ std::uint32_t gaussian_at(std::uint32_t place) const {
    return place < end_ ? lists_.splats[place] : 0;
  }
  // Starts to load this lane's splat of the next 32, and the number of the one after.
  __device__ void fetch() {
    gaussian_ = gaussian_ahead_;
    if (next_ + lane_of_thread() < end_) splat_ = load_in_vectors(lists_.of_gaussian + gaussian_);
    gaussian_ahead_ = gaussian_at(next_ + kWarp + lane_of_thread());
  }

  const TileLists& lists_;
  float x_min_, y_min_;
  std::uint32_t begin_, end_, next_;
  std::uint32_t gaussian_ = 0, gaussian_ahead_ = 0;
  Splat splat_;
};

}  // namespace gs::cuda
