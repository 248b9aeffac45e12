// SPDX-License-Identifier: Apache-2.0
// Stage 8: both of Adam's moments of one number in 32 bits, rounded at random.
#pragma once

#include <cstring>

#include "gs_core/gaussians.h"
#include "gs_core/math/adam.h"
#include "gs_core/random.h"

namespace gs {

/// Both moments of one number. The upper 16 bits are the first 16 of the float m: sign, exponent
/// and 7 bits of the mantissa. The lower 16 bits are those of the float v without its sign:
/// exponent and 8 bits of the mantissa. Both have the whole range of a float, and zero is exact.
struct MomentCode {
  std::uint32_t bits = 0;
};

inline constexpr int kDroppedBitsOfM = 16, kDroppedBitsOfV = 15;

GS_HD float first_moment(MomentCode code) {
  const std::uint32_t bits = code.bits & 0xffff0000u;
  float m;
  memcpy(&m, &bits, sizeof m);
  return m;
}
GS_HD float second_moment(MomentCode code) {
  const std::uint32_t bits = (code.bits & 0xffffu) << kDroppedBitsOfV;
  float v;
  memcpy(&v, &bits, sizeof v);
  return v;
}

/// The codes of m and v >= 0, each rounded to one of its two neighbors among the codes:
///
///   to the one away from zero with the probability (|x| - low) / (high - low)
///
/// so that the mean over `random`, uniform in 32 bits, is x itself. A decay by less than half a
/// step of the codes therefore goes on, on average, instead of being stuck. Floats of one sign are
/// ordered as their bits are, so that this is one addition below the bits that are kept. m and v
/// use different bits of `random`. What NaN becomes is undefined.
///                                             stochastic rounding: Gupta et al. 2015, Eq. 1
GS_HD MomentCode moment_code(float m, float v, std::uint32_t random) {
  std::uint32_t bits_of_m, bits_of_v;
  memcpy(&bits_of_m, &m, sizeof m);
  memcpy(&bits_of_v, &v, sizeof v);
  bits_of_m += random >> (32 - kDroppedBitsOfM);
  bits_of_v += random & ((1u << kDroppedBitsOfV) - 1);
  return {(bits_of_m & 0xffff0000u) | (bits_of_v >> kDroppedBitsOfV & 0xffffu)};
}

/// One update by Adam whose moments are codes. The parameter moves by the moments before they are
/// rounded.
GS_HD void adam_update(float& parameter, MomentCode& moments, float gradient, const AdamStep& step,
                       const AdamRule& rule, std::uint32_t random) {
  float m = first_moment(moments), v = second_moment(moments);
  adam_update(parameter, m, v, gradient, step, rule);
  moments = moment_code(m, v, random);
}

/// The random numbers of one update. They depend on seed, t and the row of the whole model alone,
/// so that every backend, any number of ranks and a resumed run round alike.
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
/// have the same, so that the right one of a static Gaussian stays the mirror of the left one:
/// numbers of opposite sign are rounded alike.
template <class T>
using PlaceOf = int;
using NumberPlaces = GaussianArrays<PlaceOf>;
inline NumberPlaces number_places() {
  NumberPlaces places{0, 3, 6, 10, 11, 14};
  places.has_time = places.has_slope = true;
  places.right_rotation = places.rotation;
  places.time_mean = 59;
  places.log_time_scale = 60;
  places.sh0_slope = 61;
  return places;
}

/// The codes of the moments of a row of a quantity.
template <class T>
struct CodedRow {
  MomentCode number[sizeof(T) / sizeof(float)];
};
template <class T>
using CodeBuffer = Buffer<CodedRow<T>>;
template <class T>
using CodeSpan = Span<CodedRow<T>>;
using MomentCodesSpan = GaussianArrays<CodeSpan>;

/// The codes one after another, whatever the rows are.
template <class T>
Span<MomentCode> codes_of(const Buffer<CodedRow<T>>& rows) {
  return {reinterpret_cast<MomentCode*>(rows.data()),
          rows.size() * (sizeof(CodedRow<T>) / sizeof(MomentCode))};
}

/// Owns the codes of the moments of N Gaussians: in the place of two `Gaussians` it has the size of
/// one.
struct MomentCodes : GaussianArrays<CodeBuffer> {
  explicit MomentCodes(Memory& memory = host_memory())
      : GaussianArrays<CodeBuffer>{CodeBuffer<Vec3f>(memory),
                                   CodeBuffer<Vec3f>(memory),
                                   CodeBuffer<Quatf>(memory),
                                   CodeBuffer<float>(memory),
                                   CodeBuffer<Vec3f>(memory),
                                   CodeBuffer<ShRest>(memory),
                                   false,
                                   CodeBuffer<Quatf>(memory),
                                   CodeBuffer<float>(memory),
                                   CodeBuffer<float>(memory),
                                   false,
                                   CodeBuffer<Vec3f>(memory),
                                   false,
                                   CodeBuffer<float>(memory)} {}

  MomentCodesSpan span() const {
    MomentCodesSpan result;
    take_learned_arrays(result, *this);
    for_each_array([](const char*, auto& to, const auto& from) { to = from.span(); }, result,
                   *this);
    return result;
  }
};

}  // namespace gs
