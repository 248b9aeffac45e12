// SPDX-License-Identifier: Apache-2.0
// The sums that blend_backward() makes for each Gaussian, and the same sums in fixed point for
// deterministic steps. The result of integer additions does not depend on their order; that of
// floating-point additions does.
#pragma once

#include "gs_core/types.h"

namespace gs::cuda {

/// dL/d(splat) of one Gaussian: three vectors of four floats, so that a warp adds its share with
/// three atomic additions.
struct alignas(16) SplatGradientSum {
  Vec2f mean2d;
  float conic_xx, conic_xy;
  float conic_yy, opacity, red, green;
  // absolute: |dL/d(mean2d)|, where asked for; else count and second of FragmentSums for the score
  // "force" (sums_among_gradients() in stages.cuh)
  float blue, absolute_x, absolute_y;
  float depth;  // of photos with a depth map; not summed here (depth.cu)
};

/// Count of numbers in a SplatGradientSum: without the absolute gradient, and with it.
inline constexpr int kGradientNumbers = 9, kAllGradientNumbers = 11;

/// The sums as integer multiples of kFine. A share x is split into a multiple of kCoarse, which is
/// rarely not zero and goes to CoarseSums, and the rest, which goes here. The rest is below 2^42
/// kFine, so that 2^21 shares can be added; a Gaussian gets at most one share from each sub-tile.
/// The rounding error, 2^-57, is far below Adam's epsilon.
struct alignas(16) FineSums {
  static constexpr float kFine = 0x1p-56f, kCoarse = 0x1p-14f;
  static constexpr float kMost = 0x1p40f;  // of a share; larger ones, and NaN, make the sum NaN
  long long numbers[kAllGradientNumbers];
  unsigned has_coarse, is_broken;
};
struct CoarseSums {
  long long numbers[kAllGradientNumbers];
};

#ifdef __CUDACC__
/// Adds a share of one number of a Gaussian's gradient.
__device__ inline void add_to(FineSums* fine, CoarseSums* coarse, int number, float share) {
  if (!(fabsf(share) < FineSums::kMost)) {
    atomicExch(&fine->is_broken, 1u);
    return;
  }
  const float steps = rintf(share * (1 / FineSums::kCoarse));
  const auto add = [&](long long* to, float multiple) {
    atomicAdd(reinterpret_cast<unsigned long long*>(to + number),
              static_cast<unsigned long long>(__float2ll_rn(multiple)));
  };
  if (steps != 0.0f) {
    atomicExch(&fine->has_coarse, 1u);
    add(coarse->numbers, steps);
  }
  const float rest = fmaf(-FineSums::kCoarse, steps, share);  // exact
  if (rest != 0.0f) add(fine->numbers, rest * (1 / FineSums::kFine));
}

/// The sum of one number. `coarse` is read only where fine.has_coarse is set.
__device__ inline float sum_of(const FineSums& fine, const CoarseSums* coarse, int number) {
  if (fine.is_broken) return __int_as_float(0x7fffffff);
  double sum = double(fine.numbers[number]) * double(FineSums::kFine);
  if (fine.has_coarse) sum += double(coarse->numbers[number]) * double(FineSums::kCoarse);
  return float(sum);
}
#endif

}  // namespace gs::cuda
