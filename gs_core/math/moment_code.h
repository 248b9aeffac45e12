// SPDX-License-Identifier: Apache-2.0
// Stage 8: Adam with moments that are codes, which are rounded at random.
#pragma once

#include "gs_core/gaussians.h"
#include "gs_core/math/adam.h"
#include "gs_core/math/moment_form.h"
#include "gs_core/math/tiny_code.h"
#include "gs_core/random.h"

namespace gs {

// A TinyCode holds both moments of one number. TinyCode::of(m, v, random) rounds each to one of its
// two neighbors among the codes:
//
//   to the one away from zero with the probability (|x| - low) / (high - low)
//
// so that the mean over `random`, uniform in 32 bits, is x itself. A decay by less than half a step
// of the codes therefore goes on, on average, instead of being stuck.
//                                             stochastic rounding: Gupta et al. 2015, Eq. 1

/// One update by Adam whose moments are codes. The parameter moves by the moments before they are
/// rounded.
GS_HD void adam_update(float& parameter, TinyCode& moments, float gradient, const AdamStep& step,
                       const AdamRule& rule, std::uint32_t random) {
  float m = first_moment(moments), v = second_moment(moments);
  adam_update(parameter, m, v, gradient, step, rule);
  moments = TinyCode::of(m, v, random);
}

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

/// The place of each quantity's first number in its row, for random_of_number(). Both rotations
/// have the same.
template <class T>
using PlaceOf = int;
using NumberPlaces = GaussianArrays<PlaceOf>;
inline NumberPlaces number_places() {
  NumberPlaces places{0, 3, 6, 10, 11, 14};
  places.has_time = true;
  places.right_rotation = places.rotation;
  places.time_mean = 59;
  places.log_time_scale = 60;
  return places;
}

/// The codes of the moments of a row of a quantity.
template <class T>
struct CodedRow {
  TinyCode number[sizeof(T) / sizeof(float)];
};

/// The codes one after another, whatever the rows are.
template <class T>
Span<TinyCode> codes_of(const Buffer<CodedRow<T>>& rows) {
  return {reinterpret_cast<TinyCode*>(rows.data()), rows.size() * (sizeof(T) / sizeof(float))};
}

template <class T>
using CodedSpan = Span<CodedRow<T>>;
template <class T>
using CodedBuffer = Buffer<CodedRow<T>>;
using MomentCodesSpan = GaussianArrays<CodedSpan>;

/// Owns the codes of the moments of N Gaussians, in the place of two `Gaussians`.
struct MomentCodes : GaussianArrays<CodedBuffer> {
  explicit MomentCodes(Memory& memory = host_memory())
      : GaussianArrays<CodedBuffer>{CodedBuffer<Vec3f>(memory),
                                    CodedBuffer<Vec3f>(memory),
                                    CodedBuffer<Quatf>(memory),
                                    CodedBuffer<float>(memory),
                                    CodedBuffer<Vec3f>(memory),
                                    CodedBuffer<ShRest>(memory),
                                    false,
                                    CodedBuffer<Quatf>(memory),
                                    CodedBuffer<float>(memory),
                                    CodedBuffer<float>(memory),
                                    false,
                                    CodedBuffer<float>(memory)} {}

  MomentCodesSpan span() const {
    MomentCodesSpan result;
    take_learned_arrays(result, *this);
    for_each_array([](const char*, auto& to, const auto& from) { to = from.span(); }, result,
                   *this);
    return result;
  }
};

}  // namespace gs
