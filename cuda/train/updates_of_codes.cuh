// SPDX-License-Identifier: Apache-2.0
// Updates of rows whose moments are codes (optimizer.moments): how a warp moves codes, and rounds
// them by the random words of its rows.
#pragma once

#include <cuda_pipeline.h>

#include "cuda/train/number_updates.cuh"

namespace gs::cuda {

/// The random numbers of these `kCount` numbers, if the quantity's numbers begin at `begin`.
template <int kCount, class RandomSource>
__device__ void load_random(const NumberPlace<RandomSource>& place, int begin,
                            std::uint32_t (&to)[kCount]) {
  const bool are_of_two_rows = place.number + kCount > place.in_row;
  const std::uint32_t of_row = place.rows.random[place.row],
                      of_next = kCount > 1 ? place.rows.random[place.row + are_of_two_rows] : 0;
  for (int k = 0; k < kCount; ++k) {
    const bool is_next = place.number + k >= place.in_row;
    to[k] = random_of_number(is_next ? of_next : of_row,
                             begin + place.number + k - (is_next ? place.in_row : 0));
  }
}

/// A code that was moved as a float of the same bits (vector_at).
__device__ inline TinyCode code_of(float number) {
  return {std::uint16_t(__float_as_uint(number))};
}
/// Writes a vector of such codes.
__device__ inline void store_codes(float* array, std::size_t at, float code) {
  reinterpret_cast<TinyCode*>(array)[at] = code_of(code);
}
__device__ inline void store_codes(float* array, std::size_t at, const float4& codes) {
  const auto bits = [](float number) { return code_of(number).bits; };
  reinterpret_cast<ushort4*>(array)[at] = {bits(codes.x), bits(codes.y), bits(codes.z),
                                           bits(codes.w)};
}

/// The whole warp: starts to copy the codes of its SH rows into shared memory: those that
/// `degree` uses, in whole vectors, with their neighbors.
template <int degree>
__device__ void start_copy_of_codes(std::uint16_t* to, const std::uint16_t* from, int rows) {
  constexpr int kInUse = kShNumbersInUse<degree>, kInVector = sizeof(float4) / sizeof(TinyCode);
  static_assert(kWarp * kShRowNumbers % kInVector == 0);
  if (rows == kWarp) {
    for (int k = kInVector * lane_of_thread(); k < kWarp * kShRowNumbers; k += kInVector * kWarp) {
      const int row = k / kShRowNumbers, next = (k + kInVector - 1) / kShRowNumbers;
      if (k % kShRowNumbers < kInUse || next > row)
        __pipeline_memcpy_async(to + k, from + k, sizeof(float4));
    }
  } else {  // two bytes are too few for an asynchronous copy
    for (int k = lane_of_thread(); k < rows * kInUse; k += kWarp) {
      const int at = k / kInUse * kShRowNumbers + k % kInUse;
      to[at] = from[at];
    }
  }
}

/// The numbers of one quantity, for UpdateByAdam, with moments that are codes. A number of a parameter
/// and its moments are 12 bytes to read and write instead of 24, so that an update of all 59
/// numbers of a Gaussian moves 708 bytes instead of 1,416.
struct AdamCodes {
  static constexpr int kArrays = 2;
  static constexpr bool kHasCodes = true;
  float* arrays[kArrays];  // parameters and codes
  AdamStep step;
  AdamRule rule;
  int place;  // NumberPlaces

  template <class Vector, class Place>
  __device__ void finish(std::size_t at, Vector (&numbers)[kArrays], const Vector& gradient,
                         const Place& of_numbers) const {
    constexpr int kCount = int(sizeof(Vector) / sizeof(float));
    std::uint32_t random[kCount];
    load_random(of_numbers, place, random);
    for (int k = 0; k < kCount; ++k) {
      float& code = reinterpret_cast<float*>(&numbers[1])[k];
      TinyCode moments = code_of(code);
      adam_update(reinterpret_cast<float*>(&numbers[0])[k], moments,
                  reinterpret_cast<const float*>(&gradient)[k], step, rule, random[k]);
      code = __uint_as_float(moments.bits);
    }
    reinterpret_cast<Vector*>(arrays[0])[at] = numbers[0];
    store_codes(arrays[1], at, numbers[1]);
  }
};

}  // namespace gs::cuda
