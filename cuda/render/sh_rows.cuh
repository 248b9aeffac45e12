// SPDX-License-Identifier: Apache-2.0
// A warp reads and updates the SH rows of its 32 Gaussians one number after another, in whole cache
// lines. The rows are copied into shared memory, where each lane reads its own row.
#pragma once

#include <cuda_pipeline.h>

#include <type_traits>

#include "cuda/device/warp.cuh"
#include "gs_core/error.h"
#include "gs_core/gaussians.h"

namespace gs::cuda {

/// Count of numbers in an SH row. It is odd, so that 32 lanes that read one row each use 32
/// different banks.
inline constexpr int kShRowNumbers = 3 * kShRestCount;
static_assert(kShRowNumbers % 2 == 1 && sizeof(ShRest) == kShRowNumbers * sizeof(float));

/// Count of numbers in an SH row that a degree uses.
template <int degree>
inline constexpr int kShNumbersInUse = 3 * sh_rest_count(degree);

/// The rows of a warp that take part, one bit for each. All of them, known when the code is
/// compiled, cost nothing.
struct EveryRow {
  __device__ bool has(int) const { return true; }
};
struct SomeRows {
  std::uint32_t bits;
  __device__ bool has(int row) const { return bits >> row & 1; }
};

/// The whole warp: starts to copy `rows` rows of kInRow numbers into shared memory, without
/// registers in between: of each row the first kInUse numbers, in whole vectors, with their
/// neighbors. Rows that do not take part may be left out. T is a number or moments of a number.
template <int kInRow, int kInUse = kInRow, class T, class RowMask = EveryRow>
__device__ void start_copy(T* to, const T* from, int rows, RowMask mask = {}) {
  constexpr int kInVector = sizeof(float4) / sizeof(T);
  static_assert(kWarp * kInRow % kInVector == 0);
  if (rows == kWarp) {
    for (int k = kInVector * lane_of_thread(); k < kWarp * kInRow; k += kInVector * kWarp) {
      const int row = k / kInRow, last = (k + kInVector - 1) / kInRow;  // of the vector
      if ((k % kInRow < kInUse && mask.has(row)) || (last > row && mask.has(last)))
        __pipeline_memcpy_async(to + k, from + k, sizeof(float4));
    }
  } else {
    // Only the last warp of an array comes here, so that speed does not matter. With asynchronous
    // copies of single numbers, nvcc 13.0 once made a kernel whose results differed from run to
    // run, and in which racecheck saw numbers copied twice.
#pragma unroll 1
    for (int k = lane_of_thread(); k < rows * kInUse; k += kWarp) {
      const int row = k / kInUse, at = row * kInRow + k % kInUse;
      if (mask.has(row)) to[at] = from[at];
    }
  }
}

/// Copies SH rows: the numbers of each row that a degree uses.
template <int degree, class T, class RowMask = EveryRow>
__device__ void start_sh_copy(T* to, const T* from, int rows, RowMask mask = {}) {
  if constexpr (degree > 0)
    start_copy<kShRowNumbers, kShNumbersInUse<degree>>(to, from, rows, mask);
}

/// Calls f(std::integral_constant<int, degree>) for the degree in use.
template <class F>
void with_sh_degree(int degree, F&& f) {
  switch (degree) {
    case 0: return f(std::integral_constant<int, 0>());
    case 1: return f(std::integral_constant<int, 1>());
    case 2: return f(std::integral_constant<int, 2>());
    case 3: return f(std::integral_constant<int, 3>());
  }
  GS_CHECK(!"an SH degree from 0 to 3");
}

/// Calls f with std::true_type or std::false_type.
template <class F>
void with_bool(bool value, F&& f) {
  value ? f(std::true_type()) : f(std::false_type());
}

/// Calls f(degree, has_time, has_lens) with the types of such constants: Gaussians in space and
/// time, a camera that is no pinhole.
template <class F>
void with_form(int degree, const GaussiansSpan& gaussians, bool has_lens, F&& f) {
  GS_CHECK(!(gaussians.has_time && gaussians.has_filter));
  with_sh_degree(degree, [&](auto sh_degree) {
    with_bool(gaussians.has_time, [&](auto time) {
      with_bool(has_lens, [&](auto lens) { f(sh_degree, time, lens); });
    });
  });
}

}  // namespace gs::cuda
