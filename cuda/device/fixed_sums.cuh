// SPDX-License-Identifier: Apache-2.0
// Additions to sums in fixed point (FineSums, CoarseSums), for deterministic steps. The result of
// integer additions does not depend on their order; that of floating-point additions does.
#pragma once

#include "gs_core/forecast/gpu_step.h"

namespace gs::cuda {

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
