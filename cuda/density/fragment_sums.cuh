// SPDX-License-Identifier: Apache-2.0
// The sums over the fragments of each Gaussian that scores of density control are made of
// (FragmentSums in gs_core/math/growth.h). blend_backward() adds to them, in floating point or, for
// deterministic steps, in fixed point.
#pragma once

#include "cuda/device/warp.cuh"
#include "gs_core/math/growth.h"

namespace gs::cuda {

/// FragmentSums in multiples of kUnit, so that the result does not depend on the order of
/// additions. A share that is not below kMost counts as nothing.
struct FixedFragmentSums {
  static constexpr float kUnit = 0x1p-36f, kMost = 0x1p24f;
  long long numbers[4];
};

/// Where blend_backward() adds. One of the first two is null, and `values` is null for the score
/// "force".
struct FragmentSink {
  FragmentSums* sums;        // (N)
  FixedFragmentSums* fixed;  // (N)
  const float* values;       // (H, W)

  /// Adds a fragment, which has the force and the weight, at a pixel of this value to `sum`. What
  /// is no fragment has the weight 0.
  __device__ void count(FragmentSums& sum, float force, float weight, float value) const {
    const bool is_kept = weight > 0;
    sum.count += is_kept ? 1.0f : 0.0f;
    sum.weight += weight;
    sum.first += values ? weight * value : force;
    sum.second += values ? (is_kept ? value : 0.0f) : force * force;
  }

  /// Adds the share that one sub-tile has in a Gaussian's sums.
  __device__ void add(std::uint32_t gaussian, const FragmentSums& share) const {
    if (sums) {
      add_to(reinterpret_cast<float4*>(sums + gaussian),
             float4{share.count, share.weight, share.first, share.second});
      return;
    }
    const float shares[] = {share.count, share.weight, share.first, share.second};
    for (int k = 0; k < 4; ++k) {
      if (!(fabsf(shares[k]) < FixedFragmentSums::kMost)) continue;
      const long long steps = __float2ll_rn(shares[k] * (1 / FixedFragmentSums::kUnit));
      atomicAdd(reinterpret_cast<unsigned long long*>(fixed[gaussian].numbers + k),
                static_cast<unsigned long long>(steps));
    }
  }
};

/// The sums of one Gaussian from fixed point.
__device__ inline FragmentSums sums_of(const FixedFragmentSums& fixed) {
  const auto number = [&](int k) {
    return float(double(fixed.numbers[k]) * double(FixedFragmentSums::kUnit));
  };
  return {number(0), number(1), number(2), number(3)};
}

}  // namespace gs::cuda
