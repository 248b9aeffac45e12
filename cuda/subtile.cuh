// SPDX-License-Identifier: Apache-2.0
// What both blend kernels share: a warp owns 8 x 4 pixels of a tile and walks the tile's list by itself, 32 splats
// at a time: each lane fetches one and tests it against the sub-tile; those that hit are listed in shared memory
// and then blended by all lanes, a pixel each. No block ever waits for another warp.
// Sub-tiles of a warp: Yang et al. 2026 (warp-level culling); the exact test: Radl et al. 2024.
#pragma once

#include <cuda_pipeline.h>

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

/// The outermost pixel centres of a sub-tile.
struct PixelRange {
  float x_min, x_max, y_min, y_max;

  __device__ PixelRange(int x0, int y0, int width, int height)
      : x_min(float(x0) + 0.5f), x_max(float(x0 + width) - 0.5f), y_min(float(y0) + 0.5f),
        y_max(float(y0 + height) - 0.5f) {}
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
  __device__ PixelRange pixels() const { return {x0, y0, kSubtileWidth, kSubtileHeight}; }
  __device__ std::size_t pixel(const TileLists& lists) const {
    return std::size_t(y) * lists.width + x;
  }
  /// This lane's place among the pixels of a tile as checkpoints hold them.
  __device__ std::size_t checkpoint(std::uint32_t slot) const {
    return std::size_t(slot) * kTileWidth * kTileHeight + number * kWarp + lane_of_thread();
  }
};

/// A splat as the pixels of a sub-tile read it. Exponents are to base 2: e = -|u|^2 with u = L^T d, d = pixel - mean.
struct alignas(16) ListedSplat {
  Vec2f mean2d;
  ConicFactors<float> L;
  float lowest;             // a fragment is kept iff e >= lowest
  float opacity, red;       // colours are not below 0
  float green, blue;
  std::uint32_t position;   // in the tile's list
  std::uint32_t gaussian;
};

__device__ inline ListedSplat listed(const Splat& splat, std::uint32_t position,
                                     std::uint32_t gaussian) {
  return {splat.mean2d,
          conic_factors(splat.conic, splat.variance_y),
          -float(kLog2E) * splat.cutoff,
          splat.opacity,
          max_of(splat.color.x, 0.0f),
          max_of(splat.color.y, 0.0f),
          max_of(splat.color.z, 0.0f),
          position,
          gaussian};
}

/// The exponent e of a fragment. Forward and backward both ask here, so that they keep the same fragments.
__device__ inline float base2_exponent(const ListedSplat& splat, float dx, float dy) {
  const float u_x = fmaf(splat.L.xx, dx, splat.L.xy * dy), u_y = splat.L.yy * dy;
  return -fmaf(u_x, u_x, u_y * u_y);
}
__device__ inline float exp2_fragment(float e) { return exp2f(e); }

/// One warp's way through positions [first, last) of a tile's list: fetches 32 splats ahead, into shared memory.
class ListWalk {
 public:
  using Ahead = Splat[kWarp];  // shared memory, one of each warp

  __device__ ListWalk(Ahead& ahead, const TileLists& lists, std::uint32_t tile,
                      const PixelRange& pixels, std::uint32_t first, std::uint32_t last)
      : splat_(ahead[lane_of_thread()]), lists_(lists), pixels_(pixels), begin_(lists.ranges[tile]),
        end_(begin_ + last), next_(begin_ + first) {
    gaussian_ahead_ = gaussian_at(next_ + lane_of_thread());
    fetch();
  }
  __device__ bool is_done() const { return next_ >= end_; }
  /// Where the next splats stand in the list.
  __device__ std::uint32_t position() const { return next_ - begin_; }

  /// The whole warp: finds those of the next 32 splats that hit the sub-tile, calls
  /// take(k, splat, position, gaussian) for the k-th of them in a lane of its own, and returns how many they are.
  template <class Take>
  __device__ int take_next(const Take& take) {
    __pipeline_wait_prior(0);
    const std::uint32_t place = next_ + lane_of_thread(), gaussian = gaussian_;
    const Splat splat = load_in_vectors(&splat_);
    // Both are evaluated: a branch would cost more.
    const bool hit = (place < end_) & rectangle_is_hit(splat.mean2d, splat.conic, splat.cutoff,
                                                       pixels_.x_min, pixels_.x_max, pixels_.y_min,
                                                       pixels_.y_max, kSubtileSlack);
    const unsigned hits = __ballot_sync(kAllLanes, hit);
    next_ += kWarp;
    fetch();
    if (hit) take(__popc(hits & lanes_below()), splat, place - begin_, gaussian);
    __syncwarp();
    return __popc(hits);
  }
  /// The same into a list.
  __device__ int list_next(ListedSplat* list) {
    return take_next([&](int k, const Splat& splat, std::uint32_t position,
                         std::uint32_t gaussian) { list[k] = listed(splat, position, gaussian); });
  }

 private:
  __device__ std::uint32_t gaussian_at(std::uint32_t place) const {
    return place < end_ ? lists_.splats[place] : 0;
  }
  // Starts to copy this lane's splat of the next 32, and to load the number of the one after.
  __device__ void fetch() {
    gaussian_ = gaussian_ahead_;
    if (next_ + lane_of_thread() < end_) {
      const float4* const from = reinterpret_cast<const float4*>(lists_.of_gaussian + gaussian_);
      for (int k = 0; k < int(sizeof(Splat) / sizeof(float4)); ++k)
        __pipeline_memcpy_async(reinterpret_cast<float4*>(&splat_) + k, from + k, sizeof(float4));
    }
    __pipeline_commit();
    gaussian_ahead_ = gaussian_at(next_ + kWarp + lane_of_thread());
  }

  Splat& splat_;  // this lane's of the next 32
  const TileLists& lists_;
  const PixelRange pixels_;
  std::uint32_t begin_, end_, next_;
  std::uint32_t gaussian_ = 0, gaussian_ahead_ = 0;
};

}  // namespace gs::cuda
