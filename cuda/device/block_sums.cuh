// SPDX-License-Identifier: Apache-2.0
// Sums over the threads of a block in an order that is always the same.
#pragma once

#include "cuda/device/warp.cuh"

namespace gs::cuda {

/// Adds up the threads' sums, by the remainder of the thread's number by kRemainders: thread
/// r < kRemainders has the sum of all threads r, r + kRemainders, r + 2 kRemainders, ...
/// afterwards, and shared[k][r] has it, too. All threads of the block take part; there are
/// kRemainders times a power of two of them, so that halving keeps each remainder.
template <int kRemainders, int kThreads, int kCount>
__device__ void sum_by_remainder(double (&sums)[kCount], double (&shared)[kCount][kThreads]) {
  static_assert(kThreads % kRemainders == 0 &&
                (kThreads / kRemainders & (kThreads / kRemainders - 1)) == 0);
  for (int k = 0; k < kCount; ++k) shared[k][threadIdx.x] = sums[k];
  for (int half = kThreads / 2; half >= kRemainders; half /= 2) {
    __syncthreads();
    if (int(threadIdx.x) < half)
      for (int k = 0; k < kCount; ++k) shared[k][threadIdx.x] += shared[k][int(threadIdx.x) + half];
  }
  __syncthreads();
  for (int k = 0; k < kCount; ++k) sums[k] = shared[k][threadIdx.x];
}

/// All threads of a block of kWarps warps: adds up their numbers. Thread k < kCount writes sum k to
/// `to`; `of_warps` is shared memory.
template <int kCount, int kWarps, class Number>
__device__ void sum_of_block(const Number (&numbers)[kCount], double (&of_warps)[kWarps][kCount],
                             double* to) {
  for (int k = 0; k < kCount; ++k) {
    const double of_warp = warp_sum(double(numbers[k]));
    if (lane_of_thread() == 0) of_warps[threadIdx.x / kWarp][k] = of_warp;
  }
  __syncthreads();
  if (int(threadIdx.x) >= kCount) return;
  double sum = 0;
  for (int warp = 0; warp < kWarps; ++warp) sum += of_warps[warp][threadIdx.x];
  to[threadIdx.x] = sum;
}

}  // namespace gs::cuda
