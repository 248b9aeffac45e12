// SPDX-License-Identifier: Apache-2.0
// The fragments that a pixel still waits with in the order by pixel, as sorted keys in registers. 16
// new ones are sorted and merged with the 16 that are held; the nearest 16 of both go on, the others
// are held. So a fragment finds its place unless more than 16 farther ones came before it. The
// header also compiles for the CPU: tests/stages/pixel_window_test.cpp.
//
// A key is the fragment's depth along the ray, whose last six bits number the place of its splat in
// shared memory. Positive floats are ordered as their bits are, so that a comparison and exchange
// takes two instructions and no branch. 0 is no fragment, and comes before all others.
#pragma once

#include "gs_core/math/render/depth_key.h"

namespace gs::cuda {

inline constexpr int kWindow = 16;  // fragments that are held, and splats of a batch
inline constexpr int kQuarters = 4;
inline constexpr int kPlaces =
    kQuarters * kWindow;  // of splats in shared memory: a quarter a batch
inline constexpr std::uint32_t kPlaceBits = 63;
static_assert(kPlaces <= int(kPlaceBits) + 1);

/// The key of a fragment at a depth above 0.
GS_HD std::uint32_t window_key(float depth, int place) {
  return (bits_of(depth) & ~kPlaceBits) | std::uint32_t(place);
}
GS_HD int place_of_key(std::uint32_t key) { return int(key & kPlaceBits); }

/// Puts the smaller of two keys first.
GS_HD void put_in_order(std::uint32_t& a, std::uint32_t& b) {
  const std::uint32_t least = min_of(a, b);
  b = max_of(a, b);
  a = least;
}

/// Keys of one pixel. All loops are unrolled, so that keys stay in registers.
struct WindowKeys {
  std::uint32_t of[kWindow];

  /// Sorts keys that rise and then fall, or fall and then rise.
  GS_HD void sort_bitonic() {
#pragma unroll
    for (int distance = kWindow / 2; distance > 0; distance /= 2)
#pragma unroll
      for (int i = 0; i < kWindow; ++i)
        if ((i & distance) == 0) put_in_order(of[i], of[i + distance]);
  }
  /// Sorts any keys, the largest first (Batcher 1968).
  GS_HD void sort_falling() {
#pragma unroll
    for (int size = 2; size <= kWindow; size *= 2)
#pragma unroll
      for (int distance = size / 2; distance > 0; distance /= 2)
#pragma unroll
        for (int i = 0; i < kWindow; ++i)
          if ((i & distance) == 0) {
            if (i & size)
              put_in_order(of[i], of[i + distance]);
            else
              put_in_order(of[i + distance], of[i]);
          }
  }
};

/// Of the arriving keys and those that are held, which rise, the smaller half becomes `arriving`
/// and the larger one `held`; both rise.
GS_HD void merge(WindowKeys& held, WindowKeys& arriving) {
  arriving.sort_falling();
#pragma unroll
  for (int i = 0; i < kWindow; ++i) put_in_order(arriving.of[i], held.of[i]);
  arriving.sort_bitonic();
  held.sort_bitonic();
}

/// How many of the keys must go on so that none with a place of the quarter is left. They rise.
GS_HD int count_up_to_quarter(const WindowKeys& held, int quarter) {
  int count = 0;
#pragma unroll
  for (int i = 0; i < kWindow; ++i)
    if (held.of[i] != 0 && place_of_key(held.of[i]) / kWindow == quarter) count = i + 1;
  return count;
}

}  // namespace gs::cuda
