// SPDX-License-Identifier: Apache-2.0
// The sums over the fragments of each Gaussian that scores of density control are made of
// (FragmentSums in gs_core/math/density/growth.h). blend_backward() adds forces to them, in
// floating point or, for deterministic steps, in fixed point. A score pass adds values of pixels in
// fixed point.
#pragma once

#include "cuda/device/warp.cuh"
#include "gs_core/forecast/gpu_step.h"

namespace gs::cuda {

/// From the forces of the mean loss to those of the loss times its values.
__device__ inline FragmentSums scaled_forces(const FragmentSums& sums, float scale) {
  return {sums.count, sums.first * scale, sums.second * (scale * scale)};
}

/// Adds a share, which may happen in any order.
__device__ inline void add_to(FixedFragmentSums& sums, const FragmentSums& share) {
  const float shares[] = {share.count, share.first, share.second};
  for (int k = 0; k < 3; ++k) {
    if (!(fabsf(shares[k]) < FixedFragmentSums::kMost)) continue;
    const long long steps = __float2ll_rn(shares[k] * (1 / FixedFragmentSums::kUnit));
    atomicAdd(reinterpret_cast<unsigned long long*>(sums.numbers + k),
              static_cast<unsigned long long>(steps));
  }
}

/// Where blend_backward() adds the sums of forces, but in floating point without absolute gradients:
/// those find room in SplatGradientSum. One of the first two is null.
struct FragmentSink {
  Vec4f* sums;               // (N)  count, first, second, 0
  FixedFragmentSums* fixed;  // (N)
  float force_scale;         // from forces of the mean loss to those of FragmentSums

  /// Adds the share that one sub-tile has in a Gaussian's sums.
  __device__ void add(std::uint32_t gaussian, const FragmentSums& share) const {
    if (sums) {
      add_to(reinterpret_cast<float4*>(sums + gaussian),
             float4{share.count, share.first, share.second, 0.0f});
      return;
    }
    add_to(fixed[gaussian], scaled_forces(share, force_scale));
  }
};

/// The sums of one Gaussian from fixed point.
__device__ inline FragmentSums sums_of(const FixedFragmentSums& fixed) {
  const auto number = [&](int k) {
    return float(double(fixed.numbers[k]) * double(FixedFragmentSums::kUnit));
  };
  return {number(0), number(1), number(2)};
}

}  // namespace gs::cuda
