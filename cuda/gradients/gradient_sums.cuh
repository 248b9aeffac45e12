// SPDX-License-Identifier: Apache-2.0
// Where blend_backward.cu adds the gradients of splats: sums in floating point or, for runs that can
// be repeated to the last bit, in fixed point, with the statistics of density control or without.
#pragma once

#include "cuda/device/fixed_sums.cuh"
#include "cuda/device/warp.cuh"
#include "cuda/stages.cuh"

namespace gs::cuda {

/// Floats from one splat's sums over the pixels to the next one's.
inline constexpr int kSumStride = 20;

/// What a sub-tile adds to one Gaussian.
struct SplatShare {
  SplatGradientSum gradient;
  FragmentSums fragments;
};

/// True for a splat none of whose fragments is kept, and hardly for another one.
__device__ inline bool is_zero(const SplatGradientSum& sum) {
  return sum.mean2d.x == 0.0f && sum.mean2d.y == 0.0f && sum.conic_xx == 0.0f &&
         sum.conic_xy == 0.0f && sum.conic_yy == 0.0f && sum.opacity == 0.0f && sum.red == 0.0f &&
         sum.green == 0.0f && sum.blue == 0.0f && sum.absolute_x == 0.0f &&
         sum.absolute_y == 0.0f && sum.depth == 0.0f;
}

/// The sums of the gradients of all Gaussians, in floating point or in fixed point. add() is called
/// by the whole warp: lane k < count has the share of the k-th splat, and scratch memory from
/// numbers[k * kSumStride] on.
template <bool kAbsolute_, bool kDepth_ = false>
struct FloatSums {
  static constexpr bool kAbsolute = kAbsolute_, kDepth = kDepth_;
  static constexpr FragmentStatistic kStatistic = FragmentStatistic::none;
  SplatGradientSum* of_gaussian;

  __device__ void add(int count, std::uint32_t gaussian, const SplatShare& share, float*) const {
    const SplatGradientSum& sum = share.gradient;
    if (lane_of_thread() >= count || is_zero(sum)) return;
    float4* const into = reinterpret_cast<float4*>(of_gaussian + gaussian);
    add_to(into, {sum.mean2d.x, sum.mean2d.y, sum.conic_xx, sum.conic_xy});
    add_to(into + 1, {sum.conic_yy, sum.opacity, sum.red, sum.green});
    if (kAbsolute || kDepth)
      add_to(into + 2, {sum.blue, sum.absolute_x, sum.absolute_y, sum.depth});
    else
      atomicAdd(&of_gaussian[gaussian].blue, sum.blue);
  }
};
/// With the score "force": count and second of FragmentSums are in place of absolute gradients.
/// sum f follows from the gradient by the opacity (gather_forces_kernel()).
struct FloatSumsOfForces : FloatSums<true> {
  static constexpr bool kAbsolute = false;
  static constexpr FragmentStatistic kStatistic = FragmentStatistic::force;

  __device__ void add(int count, std::uint32_t gaussian, SplatShare share, float* numbers) const {
    share.gradient.absolute_x = share.fragments.count;
    share.gradient.absolute_y = share.fragments.second;
    FloatSums<true>::add(count, gaussian, share, numbers);
  }
};
/// Gradient sums in fixed point: the order of additions does not matter.
template <bool kAbsolute_, bool kDepth_ = false>
struct FixedSums {
  static constexpr bool kAbsolute = kAbsolute_, kDepth = kDepth_;
  static constexpr FragmentStatistic kStatistic = FragmentStatistic::none;
  FineSums* fine;
  CoarseSums* coarse;

  // Neighboring lanes add neighboring numbers, which share sectors of memory.
  __device__ void add(int count, std::uint32_t gaussian, const SplatShare& share,
                      float* numbers) const {
    constexpr int kNumbers = kDepth      ? kAllGradientNumbers
                             : kAbsolute ? kAbsoluteNumbers
                                         : kGradientNumbers;
    const int lane = lane_of_thread();
    if (lane < count)
      store_in_vectors(reinterpret_cast<SplatGradientSum*>(numbers + lane * kSumStride),
                       share.gradient);
    __syncwarp();
    for (int first = 0; first < count * kNumbers; first += kWarp) {
      const int k = first + lane, row = k / kNumbers, number = k % kNumbers;
      const std::uint32_t owner = __shfl_sync(kAllLanes, gaussian, row % kWarp);
      if (row < count)
        add_to(fine + owner, coarse + owner, number, numbers[row * kSumStride + number]);
    }
  }
};

/// Gradient sums with the score "force", whose sums go to memory of their own. They have kernels of
/// their own, so that other steps do not pay for them.
template <class Sums>
struct WithForces : Sums {
  static constexpr FragmentStatistic kStatistic = FragmentStatistic::force;
  FragmentSink fragments;

  __device__ void add(int count, std::uint32_t gaussian, const SplatShare& share,
                      float* numbers) const {
    if (lane_of_thread() < count) fragments.add(gaussian, share.fragments);
    Sums::add(count, gaussian, share, numbers);
  }
};

}  // namespace gs::cuda
