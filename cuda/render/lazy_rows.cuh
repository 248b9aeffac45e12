// SPDX-License-Identifier: Apache-2.0
// SH of a warp's rows that may be late (optimizer.lazy): what each row has missed, and how the warp
// makes up for it. The formula is in gs_core/math/lazy_adam.h.
#pragma once

#include "cuda/device/warp.cuh"
#include "cuda/render/sh_rows.cuh"
#include "gs_core/math/lazy_adam.h"

namespace gs::cuda {

/// The color of row i, three numbers, after the updates that it has missed.
__device__ inline Vec3f caught_up_color(const MomentNumbers& moments, std::size_t i,
                                        const Vec3f& color, float length, float epsilon) {
  Vec3f result;
  for (int c = 0; c < 3; ++c) {
    float m, v;
    moments.load(3 * i + c, m, v);
    result[c] = caught_up(color[c], m, v, length, epsilon);
  }
  return result;
}

/// LazySh, as kernels take it.
struct LazyColors {
  std::uint32_t updates = 0;
  const std::uint32_t* updated_at = nullptr;
  const MissedUpdates* missed = nullptr;
  MomentNumbers of[kLazyQuantities] = {};

  __device__ bool is_late(std::size_t i) const { return updated_at[i] < updates; }
};
inline LazyColors lazy_colors(const LazySh& lazy) {
  LazyColors colors{lazy.updates, lazy.updated_at, lazy.missed};
  for_each_lazy_array(
      [&](LazyQuantity quantity, const auto&... moments) {
        colors.of[quantity] = moment_numbers(lazy.moments.form, moments...);
      },
      lazy.moments.first, lazy.moments.second, lazy.moments.compact, lazy.moments.tiny);
  return colors;
}

/// What the rows of a warp have missed, in shared memory.
struct LazyRows {
  float m_decay[kWarp], v_decay[kWarp], epsilon[kWarp], length[kLazyQuantities][kWarp];
  std::uint32_t due;  // the rows that catch up, one bit for each

  __device__ bool is_due(int row) const { return due >> row & 1; }
  /// The whole warp: takes what this lane's row i has missed, where it is one of `rows`.
  __device__ void take(const LazyColors& lazy, std::size_t i, SomeRows rows) {
    const int lane = lane_of_thread();
    CatchUp missed;
    if (rows.has(lane) && lazy.is_late(i)) missed = lazy.missed[lazy.updated_at[i]].catch_up;
    m_decay[lane] = missed.m_decay;
    v_decay[lane] = missed.v_decay;
    epsilon[lane] = missed.epsilon;
    for (int q = 0; q < kLazyQuantities; ++q) length[q][lane] = missed.length[q];
    if (lane == 0) due = rows.bits;
    __syncwarp();
  }
};

/// The whole warp: brings the SH rows of a warp up to date, which lie in shared memory.
/// load(number in the rows, m, v) gives the moments. The loads of three numbers are issued together,
/// so that the warp waits for memory once for them; more would cost too many registers.
template <int degree, class Load>
__device__ void catch_up_sh_rows(float* sh_rows, const LazyRows& lazy, int rows, Load&& load) {
  if constexpr (degree > 0) {
    constexpr int kInUse = kShNumbersInUse<degree>, kTogether = 3;
    static_assert(kInUse % kTogether == 0);
    if (!lazy.due) return;
#pragma unroll 1
    for (int begin = lane_of_thread(); begin < rows * kInUse; begin += kTogether * kWarp) {
      float m[kTogether], v[kTogether];
      const auto row_of = [&](int k) { return (begin + k * kWarp) / kInUse; };
      const auto place_of = [&](int k) {
        return row_of(k) * kShRowNumbers + (begin + k * kWarp) % kInUse;
      };
      const auto is_due = [&](int k) {
        return begin + k * kWarp < rows * kInUse && lazy.is_due(row_of(k));
      };
#pragma unroll
      for (int k = 0; k < kTogether; ++k)
        if (is_due(k)) load(place_of(k), m[k], v[k]);
#pragma unroll
      for (int k = 0; k < kTogether; ++k) {
        if (!is_due(k)) continue;
        float& number = sh_rows[place_of(k)];
        const int row = row_of(k);
        number = caught_up(number, m[k], v[k], lazy.length[kLazyShRest][row], lazy.epsilon[row]);
      }
    }
    __syncwarp();
  }
}

}  // namespace gs::cuda
