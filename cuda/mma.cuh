// SPDX-License-Identifier: Apache-2.0
// Matrix products of a warp on tensor cores, with their layouts: the only inline PTX of the project.
#pragma once

#include "cuda/warp.cuh"

namespace gs::cuda {

/// D += A B for one warp: A is 16 x 8, B is 8 x 8, D is 16 x 8. Inputs are read as TF32 (their lowest 13 bits
/// count as zero), sums are float. Lane l = 4 g + t, g = 0..7, t = 0..3, holds
///
///        column t    column t + 4              column g                column 2t   column 2t + 1
///      +-----------+-----------+            +-----------+            +-----------+-----------+
///  g   |   a[0]    |   a[2]    |     t      |   b[0]    |     g      |   d[0]    |   d[1]    |
///  g+8 |   a[1]    |   a[3]    |     t + 4  |   b[1]    |     g+8    |   d[2]    |   d[3]    |
///      +-----------+-----------+            +-----------+            +-----------+-----------+
///              A, by rows                         B                            D
///
/// PTX ISA, mma.m16n8k8 for .tf32. Before compute capability 8 the same sums are made lane by lane.
__device__ inline void multiply_add_16x8x8(float (&d)[4], const float (&a)[4],
                                           const float (&b)[2]) {
#if __CUDA_ARCH__ >= 800
  asm("mma.sync.aligned.m16n8k8.row.col.f32.tf32.tf32.f32 {%0, %1, %2, %3}, {%4, %5, %6, %7}, {%8, "
      "%9}, "
      "{%0, %1, %2, %3};"
      : "+f"(d[0]), "+f"(d[1]), "+f"(d[2]), "+f"(d[3])
      : "r"(__float_as_uint(a[0])), "r"(__float_as_uint(a[1])), "r"(__float_as_uint(a[2])),
        "r"(__float_as_uint(a[3])), "r"(__float_as_uint(b[0])), "r"(__float_as_uint(b[1])));
#else
  const int g = lane_of_thread() / 4, t = lane_of_thread() % 4;
  for (int k = 0; k < 8; ++k)
    for (int i = 0; i < 4; ++i) {
      const float top = __shfl_sync(kAllLanes, k < 4 ? a[0] : a[2], 4 * g + k % 4);
      const float bottom = __shfl_sync(kAllLanes, k < 4 ? a[1] : a[3], 4 * g + k % 4);
      const float right = __shfl_sync(kAllLanes, k < 4 ? b[0] : b[1], 4 * (2 * t + i % 2) + k % 4);
      d[i] = fmaf(i < 2 ? top : bottom, right, d[i]);
    }
#endif
}

/// The part of a number that TF32 holds; the rest, number - part, is exact.
__device__ inline float tf32_part(float number) {
  return __uint_as_float(__float_as_uint(number) & 0xffffe000u);
}

/// D += A B with A to float's precision, in two products; B holds what TF32 can hold.
__device__ inline void multiply_add_exactly(float (&d)[4], const float (&a)[4],
                                            const float (&b)[2]) {
  float high[4], low[4];
  for (int i = 0; i < 4; ++i) {
    high[i] = tf32_part(a[i]);
    low[i] = a[i] - high[i];
  }
  multiply_add_16x8x8(d, high, b);
  multiply_add_16x8x8(d, low, b);
}

}  // namespace gs::cuda
