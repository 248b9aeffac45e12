// SPDX-License-Identifier: Apache-2.0
// Stage 8: the random numbers by which Adam's moments are rounded.
#pragma once

#include "gs_core/gaussians.h"
#include "gs_core/math/random.h"

namespace gs {

/// The random numbers of one update. They depend on seed, t and the row of the whole model alone,
/// so that every backend, any number of GPUs and a resumed run round alike.
struct MomentRounding {
  std::uint64_t seed = 0;
  int t = 0;  // TrainingModel::adam_steps after the update

  GS_HD std::uint32_t of_row(std::size_t row) const {
    return Random{seed, RandomStream::moment_rounding}
        .bits(std::uint64_t(t), std::uint32_t(row))
        .word[0];
  }
};

/// The random number of one number of a row. Over rows and steps it is uniform for each number;
/// those of one row keep fixed distances, multiples of the golden ratio.
GS_HD std::uint32_t random_of_number(std::uint32_t of_row, int number) {
  return of_row + std::uint32_t(number) * 0x9E3779B1u;
}

/// What random_of_number() takes for the first number of each quantity. Both rotations have the
/// same.
template <class T>
using RandomOffsetOf = int;
using RandomOffsets = GaussianArrays<RandomOffsetOf>;
inline constexpr RandomOffsets kRandomOffsets{.mean = 0,
                                              .log_scale = 3,
                                              .rotation = 6,
                                              .logit_opacity = 10,
                                              .sh0 = 11,
                                              .sh_rest = 14,
                                              .has_time = true,
                                              .right_rotation = 6,
                                              .time_mean = 59,
                                              .log_time_scale = 60};

}  // namespace gs
