// SPDX-License-Identifier: Apache-2.0
// What an update does with the numbers of one quantity: their gradients are written to an array, or
// Adam updates them and their moments.
#pragma once

#include <algorithm>
#include <type_traits>

#include "cuda/device/warp.cuh"
#include "cuda/render/sh_rows.cuh"
#include "gs_core/math/update/adam.h"
#include "gs_core/math/update/moment_rounding.h"

namespace gs::cuda {

/// Neighbors of an array, which are moved at once.
template <class T, int count>
struct alignas(count * sizeof(T)) Few {
  T of[count];
};

/// Stands for moments where there are none.
struct NoMoments {
  static constexpr bool kIsRounded = false;
};
template <class Stored>
inline constexpr bool kHasMoments = !std::is_same_v<Stored, NoMoments>;

/// The SH rows of a warp in shared memory, aligned for copies of 16 bytes, and a random word of
/// each row, by which moments are rounded.
template <class Stored>
struct ShRows {
  alignas(16) float parameters[kWarp * kShRowNumbers];
  alignas(16) Stored moments[kWarp * kShRowNumbers];
  std::uint32_t random[kWarp];

  /// The random word of this lane's Gaussian.
  __device__ const Vec3f* coefficients() const {
    return reinterpret_cast<const Vec3f*>(parameters + lane_of_thread() * kShRowNumbers);
  }
};

/// Which numbers a finish() takes: number `number` of row `row` of the warp, and its next ones, which
/// may be in two rows of `in_row` numbers each. `random` has a word of each row.
struct ValueIndex {
  const std::uint32_t* random;
  int row, number, in_row;

  /// The random numbers of `count` numbers of a quantity (RandomOffsets).
  template <int count>
  __device__ void load_random(int offset, std::uint32_t (&to)[count]) const {
    const bool are_of_two_rows = number + count > in_row;
    const std::uint32_t of_row = random[row],
                        of_next = count > 1 ? random[row + are_of_two_rows] : 0;
    for (int k = 0; k < count; ++k) {
      const bool is_next = number + k >= in_row;
      to[k] = random_of_number(is_next ? of_next : of_row,
                               offset + number + k - (is_next ? in_row : 0));
    }
  }
};

/// The numbers of one quantity, for WriteGradients: finish() writes the gradients to an array.
struct GradientValues {
  using Stored = NoMoments;
  static constexpr int kNeighbors = 4;  // of SH rows that finish() takes at a time
  const float* parameters;
  float* gradients;

  template <int count>
  __device__ void finish(std::size_t at, const Few<float, count>&, const Few<NoMoments, count>&,
                         const Few<float, count>& gradient, const ValueIndex&) const {
    reinterpret_cast<Few<float, count>*>(gradients)[at] = gradient;
  }
};

/// The numbers of one quantity, for UpdateByAdam: finish() updates parameters and moments. A number
/// and its moments are 24 bytes to read and write with FloatMoments and 12 with HalfMoments, so an
/// update of all 59 numbers of a Gaussian moves 1,416 or 708 bytes.
template <class StoredMoments>
struct AdamValues {
  using Stored = StoredMoments;
  static constexpr int kNeighbors = std::min(4, int(16 / sizeof(Stored)));  // 16 bytes at most
  float* parameters;
  Stored* moments;
  AdamStep step;
  AdamRule rule;
  int random_offset;

  template <int count>
  __device__ void finish(std::size_t at, Few<float, count> numbers, Few<Stored, count> of_numbers,
                         const Few<float, count>& gradient, const ValueIndex& index) const {
    std::uint32_t random[count] = {};
    if constexpr (Stored::kIsRounded) index.load_random(random_offset, random);
    for (int k = 0; k < count; ++k)
      adam_update(numbers.of[k], of_numbers.of[k], gradient.of[k], step, rule, random[k]);
    reinterpret_cast<Few<float, count>*>(parameters)[at] = numbers;
    reinterpret_cast<Few<Stored, count>*>(moments)[at] = of_numbers;
  }
};

}  // namespace gs::cuda
