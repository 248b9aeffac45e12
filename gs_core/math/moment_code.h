// SPDX-License-Identifier: Apache-2.0
// Stage 8: Adam with moments that are codes, which are rounded at random; and the moments of rows
// in each of their forms.
#pragma once

#include "gs_core/gaussians.h"
#include "gs_core/math/adam.h"
#include "gs_core/math/compact_code.h"
#include "gs_core/math/moment_form.h"
#include "gs_core/math/tiny_code.h"
#include "gs_core/random.h"

namespace gs {

// A Code holds both moments of one number. Code::of(m, v, random) rounds each to one of its two
// neighbors among the codes:
//
//   to the one away from zero with the probability (|x| - low) / (high - low)
//
// so that the mean over `random`, uniform in 32 bits, is x itself. A decay by less than half a step
// of the codes therefore goes on, on average, instead of being stuck.
//                                             stochastic rounding: Gupta et al. 2015, Eq. 1

/// One update by Adam whose moments are codes. The parameter moves by the moments before they are
/// rounded.
template <class Code>
GS_HD void adam_update(float& parameter, Code& moments, float gradient, const AdamStep& step,
                       const AdamRule& rule, std::uint32_t random) {
  float m = first_moment(moments), v = second_moment(moments);
  adam_update(parameter, m, v, gradient, step, rule);
  moments = Code::of(m, v, random);
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
template <class Code, class T>
struct CodedRow {
  Code number[sizeof(T) / sizeof(float)];
};

/// The codes one after another, whatever the rows are.
template <class Code, class T>
Span<Code> codes_of(const Buffer<CodedRow<Code, T>>& rows) {
  return {reinterpret_cast<Code*>(rows.data()), rows.size() * (sizeof(T) / sizeof(float))};
}

/// The arrays of codes of one kind.
template <class Code>
struct CodeArrays {
  template <class T>
  using RowBuffer = Buffer<CodedRow<Code, T>>;
  template <class T>
  using RowSpan = Span<CodedRow<Code, T>>;
};
template <class Code>
using MomentCodesSpan = GaussianArrays<CodeArrays<Code>::template RowSpan>;

/// Owns the codes of the moments of N Gaussians, in the place of two `Gaussians`.
template <class Code>
struct MomentCodes : GaussianArrays<CodeArrays<Code>::template RowBuffer> {
  template <class T>
  using Rows = Buffer<CodedRow<Code, T>>;

  explicit MomentCodes(Memory& memory = host_memory())
      : GaussianArrays<CodeArrays<Code>::template RowBuffer>{Rows<Vec3f>(memory),
                                                             Rows<Vec3f>(memory),
                                                             Rows<Quatf>(memory),
                                                             Rows<float>(memory),
                                                             Rows<Vec3f>(memory),
                                                             Rows<ShRest>(memory),
                                                             false,
                                                             Rows<Quatf>(memory),
                                                             Rows<float>(memory),
                                                             Rows<float>(memory),
                                                             false,
                                                             Rows<Vec3f>(memory),
                                                             false,
                                                             Rows<float>(memory)} {}

  MomentCodesSpan<Code> span() const {
    MomentCodesSpan<Code> result;
    take_learned_arrays(result, *this);
    for_each_array([](const char*, auto& to, const auto& from) { to = from.span(); }, result,
                   *this);
    return result;
  }
};

/// Adam's moments of rows, in the form that they have; the arrays of the other forms are empty.
struct MomentsSpan {
  MomentForm form = MomentForm::floats;
  GaussiansSpan first, second;
  MomentCodesSpan<CompactCode> compact;
  MomentCodesSpan<TinyCode> tiny;
};

/// The moments of the numbers of one quantity, in the form that they have; the other pointers are
/// null.
struct MomentNumbers {
  float *m, *v;
  CompactCode* compact;
  TinyCode* tiny;

  GS_HD bool are_codes() const { return compact || tiny; }
  GS_HD void load(std::size_t at, float& of_m, float& of_v) const {
    if (compact) {
      of_m = first_moment(compact[at]);
      of_v = second_moment(compact[at]);
    } else if (tiny) {
      of_m = first_moment(tiny[at]);
      of_v = second_moment(tiny[at]);
    } else {
      of_m = m[at];
      of_v = v[at];
    }
  }
  /// `random` rounds codes; floats do not need it.
  GS_HD void store(std::size_t at, float of_m, float of_v, std::uint32_t random) const {
    if (compact) {
      compact[at] = CompactCode::of(of_m, of_v, random);
    } else if (tiny) {
      tiny[at] = TinyCode::of(of_m, of_v, random);
    } else {
      m[at] = of_m;
      v[at] = of_v;
    }
  }
};
/// Of the arrays of one quantity, of which those of `form` are taken.
template <class T>
MomentNumbers moment_numbers(MomentForm form, const Span<T>& m, const Span<T>& v,
                             const Span<CodedRow<CompactCode, T>>& compact,
                             const Span<CodedRow<TinyCode, T>>& tiny) {
  MomentNumbers numbers{};
  if (form == MomentForm::compact) {
    numbers.compact = reinterpret_cast<CompactCode*>(compact.data);
  } else if (form == MomentForm::tiny) {
    numbers.tiny = reinterpret_cast<TinyCode*>(tiny.data);
  } else {
    numbers.m = reinterpret_cast<float*>(m.data);
    numbers.v = reinterpret_cast<float*>(v.data);
  }
  return numbers;
}

}  // namespace gs
