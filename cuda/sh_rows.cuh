// SPDX-License-Identifier: Apache-2.0
// A warp reads and updates the SH rows of its 32 Gaussians one number after another, in whole cache
// lines. The rows are copied into shared memory, where each lane reads its own row.
#pragma once

#include <cuda_pipeline.h>

#include <type_traits>

#include "cuda/warp.cuh"
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

/// The whole warp: starts to copy `rows` rows of kInRow numbers into shared memory, without
/// registers in between.
template <int kInRow>
__device__ void start_copy(float* to, const float* from, int rows) {
  if (rows == kWarp) {
    for (int k = 4 * lane_of_thread(); k < kWarp * kInRow; k += 4 * kWarp)
      __pipeline_memcpy_async(to + k, from + k, sizeof(float4));
  } else {
    for (int k = lane_of_thread(); k < rows * kInRow; k += kWarp)
      __pipeline_memcpy_async(to + k, from + k, sizeof(float));
  }
}

/// The same for SH rows: copies the numbers of each row that a degree uses.
template <int degree>
__device__ void start_sh_copy(float* to, const float* from, int rows) {
  if constexpr (degree == kMaxShDegree) {
    start_copy<kShRowNumbers>(to, from, rows);
  } else if constexpr (degree > 0) {
    constexpr int kInUse = kShNumbersInUse<degree>;
    for (int k = lane_of_thread(); k < rows * kInUse; k += kWarp) {
      const int at = k / kInUse * kShRowNumbers + k % kInUse;
      __pipeline_memcpy_async(to + at, from + at, sizeof(float));
    }
  }
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

/// The same with std::true_type for Gaussians in space and time, else std::false_type.
template <class F>
void with_form(int degree, bool has_time, F&& f) {
  with_sh_degree(degree, [&](auto sh_degree) {
    if (has_time)
      f(sh_degree, std::true_type());
    else
      f(sh_degree, std::false_type());
  });
}

}  // namespace gs::cuda
