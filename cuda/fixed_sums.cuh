// SPDX-License-Identifier: Apache-2.0
// What blend_backward() adds up for each Gaussian, and the same sums in fixed point, for deterministic steps: additions of
// integers have one result, whatever their order, and floating-point ones do not.
#pragma once

#include "gs_core/types.h"

namespace gs::cuda {

/// dL/d(splat) of one Gaussian, as blend_backward() adds it up: three vectors of four floats, so that a warp's
/// share is three atomic additions.
struct alignas(16) SplatGradientSum {
  Vec2f mean2d;
  float conic_xx, conic_xy;
  float conic_yy, opacity, red, green;
  float blue, absolute_x, absolute_y, unused;  // absolute: by the mean, only with RenderSettings::absolute_gradient
};

/// Numbers of a SplatGradientSum, in its order: without the absolute gradient, and with it.
inline constexpr int kGradientNumbers = 9, kAllGradientNumbers = 11;

/// The sums as multiples of kFine. A share x is added as two integers: what of it is a multiple of kCoarse to CoarseSums,
/// which is rarely anything, the rest here. That rest is below 2^42 kFine, so that 2^21 shares can be added; a Gaussian
/// has at most one of each sub-tile. What rounds off, 2^-57, lies far below what Adam's epsilon lets pass.
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

/// The sum of one number; `coarse` is looked at only where `fine` says that something is there.
__device__ inline float sum_of(const FineSums& fine, const CoarseSums* coarse, int number) {
  if (fine.is_broken) return __int_as_float(0x7fffffff);
  double sum = double(fine.numbers[number]) * double(FineSums::kFine);
  if (fine.has_coarse) sum += double(coarse->numbers[number]) * double(FineSums::kCoarse);
  return float(sum);
}
#endif

}  // namespace gs::cuda
