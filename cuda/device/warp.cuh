// SPDX-License-Identifier: Apache-2.0
// Operations that the threads of a warp do together.
#pragma once

#include <cuda_runtime.h>

#include <cstdint>

namespace gs::cuda {

inline constexpr int kWarp = 32;
inline constexpr unsigned kAllLanes = 0xffffffffu;

__device__ inline int lane_of_thread() { return int(threadIdx.x) % kWarp; }

/// The lanes below this one, as a mask.
__device__ inline unsigned lanes_below() { return (1u << lane_of_thread()) - 1u; }

/// The sum over all lanes, in every lane.
template <class T>
__device__ inline T warp_sum(T value) {
  for (int offset = kWarp / 2; offset > 0; offset /= 2)
    value += __shfl_xor_sync(kAllLanes, value, offset);
  return value;
}

/// The largest value of all lanes, in every lane.
template <class T>
__device__ inline T warp_max(T value) {
  for (int offset = kWarp / 2; offset > 0; offset /= 2) {
    const T other = __shfl_xor_sync(kAllLanes, value, offset);
    value = other > value ? other : value;
  }
  return value;
}

/// Sum of the values of the lanes below this one.
__device__ inline std::uint32_t warp_exclusive_sum(std::uint32_t value) {
  std::uint32_t sum = value;
  for (int offset = 1; offset < kWarp; offset *= 2) {
    const std::uint32_t below = __shfl_up_sync(kAllLanes, sum, offset);
    if (lane_of_thread() >= offset) sum += below;
  }
  return sum - value;
}

/// Reads and writes a value 16 bytes at a time; it is aligned to 16.
template <class T>
union InVectors {
  static constexpr int kVectors = sizeof(T) / sizeof(float4);
  static_assert(sizeof(T) % sizeof(float4) == 0 && alignof(T) == sizeof(float4));
  __device__ InVectors() {}
  float4 vectors[kVectors];
  T value;
};
template <class T>
__device__ inline T load_in_vectors(const T* from) {
  InVectors<T> result;
  for (int k = 0; k < result.kVectors; ++k)
    result.vectors[k] = reinterpret_cast<const float4*>(from)[k];
  return result.value;
}
template <class T>
__device__ inline void store_in_vectors(T* to, const T& value) {
  InVectors<T> copy;
  copy.value = value;
  for (int k = 0; k < copy.kVectors; ++k) reinterpret_cast<float4*>(to)[k] = copy.vectors[k];
}

/// *to += value, atomically for each float: one instruction from compute capability 9 on, four
/// before.
__device__ inline void add_to(float4* to, const float4& value) {
#if __CUDA_ARCH__ >= 900
  atomicAdd(to, value);
#else
  float* const p = reinterpret_cast<float*>(to);
  atomicAdd(p, value.x);
  atomicAdd(p + 1, value.y);
  atomicAdd(p + 2, value.z);
  atomicAdd(p + 3, value.w);
#endif
}

}  // namespace gs::cuda
