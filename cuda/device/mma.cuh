// SPDX-License-Identifier: Apache-2.0
// Matrix products of a warp on tensor cores, their layouts, and the loads that feed them. This is
// the only inline PTX of the project.
#pragma once

#include "cuda/device/warp.cuh"

namespace gs::cuda {

/// The number cut off to TF32; the rest, number - part, is exact.
__device__ inline float tf32_part(float number) {
  return __uint_as_float(__float_as_uint(number) & 0xffffe000u);
}

/// D += A B for one warp: A is 16 x 8, B is 8 x 8, D is 16 x 8. Inputs are read as TF32 (their
/// lowest 13 bits count as zero), sums are float. Lane l = 4 g + t, g = 0..7, t = 0..3, holds
///
///        column t    column t + 4              column g                column 2t   column 2t + 1
///      +-----------+-----------+            +-----------+            +-----------+-----------+
///  g   |   a[0]    |   a[2]    |     t      |   b[0]    |     g      |   d[0]    |   d[1]    |
///  g+8 |   a[1]    |   a[3]    |     t + 4  |   b[1]    |     g+8    |   d[2]    |   d[3]    |
///      +-----------+-----------+            +-----------+            +-----------+-----------+
///              A, by rows                         B                            D
///
/// PTX ISA, mma.m16n8k8 for .tf32. Before compute capability 8 each lane makes the same sums with
/// fmaf.
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
      const float top = tf32_part(__shfl_sync(kAllLanes, k < 4 ? a[0] : a[2], 4 * g + k % 4));
      const float bottom = tf32_part(__shfl_sync(kAllLanes, k < 4 ? a[1] : a[3], 4 * g + k % 4));
      const float right =
          tf32_part(__shfl_sync(kAllLanes, k < 4 ? b[0] : b[1], 4 * (2 * t + i % 2) + k % 4));
      d[i] = fmaf(i < 2 ? top : bottom, right, d[i]);
    }
#endif
}

/// D += A B for one warp: A is 16 x 16, B is 16 x 8, D is 16 x 8. Inputs are halves, two to a word,
/// sums are float. Lane l = 4 g + t holds
///
///        columns 2t, 2t+1   2t+8, 2t+9               column g                column 2t   column 2t + 1
///      +------------------+------------+            +---------+            +-----------+-----------+
///  g   |       a[0]       |    a[2]    |   2t, 2t+1 |  b[0]   |     g      |   d[0]    |   d[1]    |
///  g+8 |       a[1]       |    a[3]    |   2t+8, +9 |  b[1]   |     g+8    |   d[2]    |   d[3]    |
///      +------------------+------------+            +---------+            +-----------+-----------+
///                A, by rows                            B                            D
///
/// PTX ISA, mma.m16n8k16 for .f16. Compute capability 8 and later; its kernel is not launched on
/// older GPUs.
__device__ inline void multiply_add_16x8x16(float (&d)[4], const unsigned (&a)[4],
                                            const unsigned (&b)[2]) {
#if __CUDA_ARCH__ >= 800
  asm("mma.sync.aligned.m16n8k16.row.col.f32.f16.f16.f32 {%0, %1, %2, %3}, {%4, %5, %6, %7}, {%8, "
      "%9}, "
      "{%0, %1, %2, %3};"
      : "+f"(d[0]), "+f"(d[1]), "+f"(d[2]), "+f"(d[3])
      : "r"(a[0]), "r"(a[1]), "r"(a[2]), "r"(a[3]), "r"(b[0]), "r"(b[1]));
#else
  __trap();
#endif
}

/// Loads four matrices of 8 rows of 16 bytes from shared memory, each as a right-hand side B above:
/// the rows in memory become columns, and lane 4 g + t gets halves 2t and 2t + 1 of row g. Lane l
/// passes the address of row l % 8 of matrix l / 8.   PTX ISA, ldmatrix
__device__ inline void load_four_matrices(unsigned (&words)[4], const void* row) {
#if __CUDA_ARCH__ >= 800
  asm volatile("ldmatrix.sync.aligned.m8n8.x4.shared.b16 {%0, %1, %2, %3}, [%4];"
               : "=r"(words[0]), "=r"(words[1]), "=r"(words[2]), "=r"(words[3])
               : "r"(static_cast<unsigned>(__cvta_generic_to_shared(row)))
               : "memory");
#else
  __trap();
#endif
}

/// A B with A in full fp32 precision: A is split into two TF32 parts, whose products are added to
/// two sums. B must be exact in TF32.
__device__ inline void multiply_add_in_parts(float (&high_sum)[4], float (&low_sum)[4],
                                             const float (&a)[4], const float (&b)[2]) {
  float low[4];
  for (int i = 0; i < 4; ++i) low[i] = a[i] - tf32_part(a[i]);
  multiply_add_16x8x8(high_sum, a, b);
  multiply_add_16x8x8(low_sum, low, b);
}
/// D += A B with the same split and one sum.
__device__ inline void multiply_add_exactly(float (&d)[4], const float (&a)[4],
                                            const float (&b)[2]) {
  multiply_add_in_parts(d, d, a, b);
}
/// D += A B with both sides in two parts, whose smallest product is left out.
__device__ inline void multiply_add_both_in_parts(float (&d)[4], const float (&a)[4],
                                                  const float (&b)[2]) {
  const float rest[2] = {b[0] - tf32_part(b[0]), b[1] - tf32_part(b[1])};
  multiply_add_16x8x8(d, a, rest);
  multiply_add_exactly(d, a, b);
}

}  // namespace gs::cuda
