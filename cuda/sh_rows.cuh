// SPDX-License-Identifier: Apache-2.0
// How a warp reads and updates the SH rows of its 32 Gaussians: number after number, so that it touches whole
// cache lines, through a copy in shared memory that each lane then reads its own row of.
#pragma once

#include <type_traits>

#include "cuda/warp.cuh"
#include "gs_core/error.h"
#include "gs_core/gaussians.h"

namespace gs::cuda {

/// Numbers of an SH row. Odd, so that 32 lanes that read one row each read from 32 different banks.
inline constexpr int kShRowNumbers = 3 * kShRestCount;
static_assert(kShRowNumbers % 2 == 1 && sizeof(ShRest) == kShRowNumbers * sizeof(float));

/// Numbers of an SH row that a degree uses.
template <int degree>
inline constexpr int kShNumbersInUse = 3 * sh_rest_count(degree);

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

}  // namespace gs::cuda
