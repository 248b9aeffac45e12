// SPDX-License-Identifier: Apache-2.0
// How the callers' rows of SH coefficients lie in memory, and how a warp reads and writes those of its
// 32 Gaussians: back to back in whole vectors of 16 bytes, or else number by number.
#pragma once

#include "cuda/render/sh_rows.cuh"
#include "gs_core/math/render/sh.h"
#include "gs_render/operator.h"

namespace gs::cuda {

enum class ShLayout {
  none,   // colors
  rest,   // (N, 15, 3) back to back, sh0 elsewhere
  whole,  // (N, 16, 3) back to back, sh0 in front of each row
  any,    // with gaps, or of a lower degree
};

/// Numbers of a row in memory and from row to row in shared memory, and where those beyond the first
/// coefficient begin. Rows of 52 numbers keep their vectors whole; four lanes that read their own rows
/// share a bank.
template <ShLayout layout>
struct ShRowShape {
  static constexpr int kNumbers = layout == ShLayout::whole ? 3 * kShBasisCount : kShRowNumbers;
  static constexpr int kStride = layout == ShLayout::whole ? 52 : kShRowNumbers;
  static constexpr int kFirst = layout == ShLayout::whole ? 3 : 0;
  static constexpr bool kIsVector = layout == ShLayout::rest || layout == ShLayout::whole;
};
template <>
struct ShRowShape<ShLayout::none> {
  static constexpr int kStride = 0;
};

/// The layout of arrays of parameters or of gradients, whose coefficients may all be absent.
template <class Number>
ShLayout layout_of(const OperatorArrays<Number>& arrays, int degree) {
  const auto is_aligned = [](const void* data) {
    return reinterpret_cast<std::uintptr_t>(data) % sizeof(float4) == 0;
  };
  const OperatorRows<Number>&sh0 = arrays.sh0, &rest = arrays.sh_rest;
  if (!sh0.data) return ShLayout::none;
  if (degree == 0) return ShLayout::any;
  const bool is_whole = rest.data == sh0.data + 3 && sh0.stride == rest.stride;
  if (is_whole && sh0.stride == std::size_t(ShRowShape<ShLayout::whole>::kNumbers) &&
      is_aligned(sh0.data))
    return ShLayout::whole;
  if (!is_whole && rest.stride == std::size_t(kShRowNumbers) && is_aligned(rest.data))
    return ShLayout::rest;
  return ShLayout::any;
}

/// Calls f(std::integral_constant<ShLayout, layout>()).
template <class F>
void with_layout(ShLayout layout, F&& f) {
  switch (layout) {
    case ShLayout::none: return f(std::integral_constant<ShLayout, ShLayout::none>());
    case ShLayout::rest: return f(std::integral_constant<ShLayout, ShLayout::rest>());
    case ShLayout::whole: return f(std::integral_constant<ShLayout, ShLayout::whole>());
    case ShLayout::any: return f(std::integral_constant<ShLayout, ShLayout::any>());
  }
}

/// A warp's rows, in shared memory. Coefficients of unused degrees are zero there, so that formulas
/// take all of them.
template <ShLayout layout>
struct alignas(16) GivenShRows {
  using Shape = ShRowShape<layout>;
  float numbers[kWarp * Shape::kStride];

  __device__ Vec3f* row(int lane) {
    return reinterpret_cast<Vec3f*>(numbers + lane * Shape::kStride + Shape::kFirst);
  }
  /// The whole warp: starts to load the visible ones of its rows.
  __device__ void start(const OperatorArrays<const float>& arrays, std::size_t first, int rows,
                        int degree, SomeRows visible) {
    const int lane = lane_of_thread();
    if (Shape::kIsVector && rows == kWarp) {
      const float* const from =
          (Shape::kFirst ? arrays.sh0.data : arrays.sh_rest.data) + first * Shape::kNumbers;
      if constexpr (layout == ShLayout::rest) {
        start_copy<kShRowNumbers>(numbers, from, rows, visible);
      } else {
        constexpr int kVectors = Shape::kNumbers / 4;
        for (int k = lane; k < kWarp * kVectors; k += kWarp)
          if (visible.has(k / kVectors))
            __pipeline_memcpy_async(numbers + k / kVectors * Shape::kStride + k % kVectors * 4,
                                    from + 4 * k, sizeof(float4));
      }
      return;
    }
    const int in_use = 3 * sh_rest_count(degree);
#pragma unroll 8
    for (int row = 0; row < kWarp; ++row) {
      if (!visible.has(row)) continue;
      const float* const from_row = arrays.sh_rest[first + row];
      float* const to = numbers + row * Shape::kStride + Shape::kFirst;
      static_assert(kShRowNumbers <= 2 * kWarp);
      if (lane < in_use) to[lane] = from_row[lane];
      if (lane + kWarp < in_use) to[lane + kWarp] = from_row[lane + kWarp];
    }
  }
  /// The whole warp: waits for them.
  __device__ void finish(int degree) {
    __pipeline_commit();
    __pipeline_wait_prior(0);
    __syncwarp();
    if (degree == kMaxShDegree) return;
    Vec3f* const mine = row(lane_of_thread());
#pragma unroll
    for (int k = 0; k < kShRestCount; ++k)
      if (k >= sh_rest_count(degree)) mine[k] = Vec3f(0.0f);
  }
};
template <>
struct GivenShRows<ShLayout::none> {};

}  // namespace gs::cuda
