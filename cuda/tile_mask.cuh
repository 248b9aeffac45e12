// SPDX-License-Identifier: Apache-2.0
// The candidate tiles of a splat, those of its bounding rectangle, row by row; and the bit mask of those that it
// hits, which the count leaves for the emission, so that the two cannot disagree.
#pragma once

#include "cuda/warp.cuh"
#include "gs_core/math/tile_bounds.h"

namespace gs::cuda {

/// Splats with more candidates than this are tested a second time when their instances are created.
inline constexpr std::uint32_t kTileMaskBits = 64;

struct TilePosition {
  int x, y;
};

__device__ inline std::uint32_t tile_area(const Rect& tiles) {
  return std::uint32_t(tiles.x_end - tiles.x_begin) * std::uint32_t(tiles.y_end - tiles.y_begin);
}

/// Candidate k of a rectangle of tiles.
__device__ inline TilePosition nth_tile(const Rect& tiles, std::uint32_t k) {
  const std::uint32_t columns = tiles.x_end - tiles.x_begin, row = k / columns;
  return {int(tiles.x_begin + (k - row * columns)), int(tiles.y_begin + row)};
}

/// Of 32 owners of consecutive items, the one of `item`; first[k] is the first item of owner k, and owners
/// without items have the first item of the next.
__device__ inline int owner_of(std::uint32_t item, const std::uint32_t* first) {
  int owner = 0;
#pragma unroll
  for (int step = kWarp / 2; step > 0; step /= 2)
    if (first[owner + step] <= item) owner += step;
  return owner;
}

/// The place of the n-th set bit, n = 0, 1, ...; there are more than n.
__device__ inline int nth_set_bit(std::uint64_t mask, std::uint32_t n) {
  int place = 0;
#pragma unroll
  for (int width = 32; width > 0; width /= 2) {
    const std::uint32_t low = __popcll(mask & ((1ull << width) - 1));
    if (n >= low) {
      n -= low;
      mask >>= width;
      place += width;
    }
  }
  return place;
}

}  // namespace gs::cuda
