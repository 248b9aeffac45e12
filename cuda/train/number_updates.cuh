// SPDX-License-Identifier: Apache-2.0
// What an update does with the numbers of one quantity: their gradients are written to an array, or
// Adam updates them. Those whose moments are codes are in updates_of_codes.cuh.
#pragma once

#include <type_traits>

#include "cuda/device/warp.cuh"
#include "cuda/render/sh_rows.cuh"
#include "gs_core/math/moment_code.h"

namespace gs::cuda {

/// Shared memory of a warp for moments that are codes: a random word of each row, by which they are
/// rounded, and the codes of its SH rows. Empty for moments that are floats.
template <bool has_codes>
struct CodeRows {
  std::uint32_t random[kWarp];
  alignas(16) std::uint16_t sh_codes[kWarp * kShRowNumbers];  // bits of TinyCode
};
template <>
struct CodeRows<false> {};
/// The arrays of a quantity whose SH rows lie in shared memory as floats.
template <class Numbers>
inline constexpr int kFloatArrays = Numbers::kArrays - Numbers::kHasCodes;

/// Array `a` of the SH rows of a warp, for vector_at().
template <class Numbers, class Shared>
__device__ const float* sh_rows_of(const Shared& shared, int a) {
  if constexpr (Numbers::kHasCodes)
    if (a == kFloatArrays<Numbers>) return reinterpret_cast<const float*>(shared.sh_codes);
  return shared.sh_rows[a];
}

/// Which numbers a finish() takes: number `number` of row `row` of the warp, or four from there on,
/// which may be in two rows of `in_row` numbers each.
template <class RandomSource>
struct NumberPlace {
  const RandomSource& rows;
  int row, number, in_row;
};

/// Vector `at` of array `a` of a quantity, or of a copy of that array. Vector is float or float4.
/// The array of codes has half of the length; its codes become floats of the same bits.
template <class Numbers, class Vector = float>
__device__ Vector vector_at(const float* array, int a, std::size_t at) {
  if constexpr (Numbers::kHasCodes) {
    if (a == Numbers::kArrays - 1) {
      if constexpr (std::is_same_v<Vector, float>) {
        return __uint_as_float(reinterpret_cast<const std::uint16_t*>(array)[at]);
      } else {
        const ushort4 codes = reinterpret_cast<const ushort4*>(array)[at];
        return {__uint_as_float(codes.x), __uint_as_float(codes.y), __uint_as_float(codes.z),
                __uint_as_float(codes.w)};
      }
    }
  }
  return reinterpret_cast<const Vector*>(array)[at];
}

/// Of a warp's SH rows in shared memory: vector `at` of all arrays.
template <class Shared, class Numbers, class Vector>
__device__ void load_sh(const Shared& shared, const Numbers&, int at,
                        Vector (&loaded)[Numbers::kArrays]) {
  for (int a = 0; a < Numbers::kArrays; ++a)
    loaded[a] = vector_at<Numbers, Vector>(sh_rows_of<Numbers>(shared, a), a, at);
}

/// The numbers of one quantity, for WriteGradients: finish() writes the gradient to an array.
/// Vector is float or float4.
struct GradientNumbers {
  static constexpr int kArrays = 1;
  static constexpr bool kHasCodes = false;
  float* arrays[kArrays];
  float* gradients;

  template <class Vector, class Place>
  __device__ void finish(std::size_t at, Vector (&)[kArrays], const Vector& gradient,
                         const Place&) const {
    reinterpret_cast<Vector*>(gradients)[at] = gradient;
  }
};

/// The numbers of one quantity, for UpdateByAdam: finish() updates the parameter and its moments, or
/// four neighbors at a time.
struct AdamNumbers {
  static constexpr int kArrays = 3;
  static constexpr bool kHasCodes = false;
  float* arrays[kArrays];  // parameters, first and second moments
  AdamStep step;
  AdamRule rule;

  template <class Vector, class Place>
  __device__ void finish(std::size_t at, Vector (&numbers)[kArrays], const Vector& gradient,
                         const Place&) const {
    for (int k = 0; k < int(sizeof(Vector) / sizeof(float)); ++k)
      adam_update(reinterpret_cast<float*>(&numbers[0])[k],
                  reinterpret_cast<float*>(&numbers[1])[k],
                  reinterpret_cast<float*>(&numbers[2])[k],
                  reinterpret_cast<const float*>(&gradient)[k], step, rule);
    for (int a = 0; a < kArrays; ++a) reinterpret_cast<Vector*>(arrays[a])[at] = numbers[a];
  }
};

}  // namespace gs::cuda
