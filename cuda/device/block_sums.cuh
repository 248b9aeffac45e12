// SPDX-License-Identifier: Apache-2.0
// Sums over the threads of a block in an order that is always the same.
#pragma once

#include <cuda_runtime.h>

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

}  // namespace gs::cuda
