// SPDX-License-Identifier: Apache-2.0
// The order in which lists are blended: in classes of about the same length, four for each
// doubling, the longest first, so that a picture does not end with a few long lists.
#pragma once

#include "cuda/device/warp.cuh"

namespace gs::cuda {

inline constexpr int kLengthClasses = 128;

/// The class of a length: the exponent and two bits of its mantissa.
__device__ inline int length_class(std::uint32_t length) {
  const int quarter_octaves = int(__float_as_uint(float(length)) >> 21) - int(0x3f800000u >> 21);
  return length ? max(kLengthClasses - 2 - quarter_octaves, 0) : kLengthClasses - 1;
}

/// A counting sort by class, within one block.
struct ClassSort {
  std::uint32_t next[kLengthClasses];

  __device__ void clear() {
    if (threadIdx.x < kLengthClasses) next[threadIdx.x] = 0;
  }
  __device__ void count(std::uint32_t length) { atomicAdd(&next[length_class(length)], 1u); }
  /// One warp: turns the counts into the first place of each class. Returns the total.
  __device__ std::uint32_t sum() {
    std::uint32_t before = 0;
    for (int base = 0; base < kLengthClasses; base += kWarp) {
      const std::uint32_t counted = next[base + lane_of_thread()],
                          first = warp_exclusive_sum(counted);
      next[base + lane_of_thread()] = before + first;
      before += __shfl_sync(kAllLanes, first + counted, kWarp - 1);
    }
    return before;
  }
  __device__ std::uint32_t place(std::uint32_t length) {
    return atomicAdd(&next[length_class(length)], 1u);
  }
};

}  // namespace gs::cuda
