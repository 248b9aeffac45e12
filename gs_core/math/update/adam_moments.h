// SPDX-License-Identifier: Apache-2.0
// Stage 8: both of Adam's moments of one number are one value, FloatMoments or HalfMoments.
// opened() reads either, and store() writes it. Both have no constructor, so that they can lie in a
// GPU's shared memory; FloatMoments{} and HalfMoments{} are zero.
#pragma once

#include <cstring>

#include "gs_core/types.h"

namespace gs {

/// m and v of one number, beside each other, so that a thread reads both at once.
struct alignas(8) FloatMoments {
  float first, second;

  static constexpr bool kIsRounded = false;
  bool operator==(const FloatMoments&) const = default;
};
GS_HD FloatMoments opened(const FloatMoments& moments) { return moments; }
/// `random` has no effect: nothing is rounded.
GS_HD void store(FloatMoments& to, const FloatMoments& moments, std::uint32_t) { to = moments; }

/// Both moments of one number in 16 bits: the sign of m, 6 bits of its size, and 9 bits of v.
///
///   v = 0 for the code 0, else (1 + (c mod 4) / 4) 2^(floor(c / 4) - 100)        c = 1 .. 511
///   |m| = n d,  d = 2^(floor(c / 8) - 56)                                        k = 0 .. 63
///   n   = k for k < 8, else (8 + k mod 8) 2^(floor(k / 8) - 1)                   up to 960
///
/// So v has four codes an octave from 1.25 2^-100, whose root is Adam's epsilon, to 1.75 2^27.
/// sqrt(v) lies in [64 d, 120 d). Up to |m| = 16 d its steps are d, and from there on 1/16 to 1/8
/// of |m|. The largest |m| is 960 d, between 8 and 15 sqrt(v).
/// All of it is arithmetic of integers, so that every processor has the same bits.
struct HalfMoments {
  std::uint16_t bits;

  static constexpr bool kIsRounded = true;
  static constexpr int kBitsOfV = 9, kBitsOfM = 6;
  static constexpr std::uint32_t kMostV = (1u << kBitsOfV) - 1, kMostM = (1u << kBitsOfM) - 1;
  static constexpr std::uint32_t kSignOfM = 0x8000;
  // Bits of the floats below those that are kept, and how many random bits decide about them
  static constexpr int kDroppedBitsOfM = 20, kDroppedBitsOfV = 21;
  static constexpr int kRandomBitsOfM = 14, kRandomBitsOfV = 18;
  static constexpr std::uint32_t kNumbersInOctave = 8;    // of m
  static constexpr std::uint32_t kLeastV = 27u << 2;      // the upper bits of 2^-100
  static constexpr std::uint32_t kExponentOfFinest = 74;  // of 8 d, as in a float, for c < 8

  /// The exponent of 8 d, as in a float. From there on steps are as in floats.
  static GS_HD std::uint32_t exponent_of_steps(std::uint32_t code_of_v) {
    return (code_of_v >> 3) + kExponentOfFinest;
  }

  /// The code of m and v >= 0, each rounded by `random`, uniform in 32 bits, to one of its two
  /// neighbors among the codes:
  ///
  ///   to the one away from zero with the probability (|x| - low) / (high - low)
  ///
  /// so that the mean over `random` is x itself. A decay by less than half a step of the codes
  /// therefore goes on, on average, instead of being stuck.
  ///                                           stochastic rounding: Gupta et al. 2015, Eq. 1
  /// The steps of m go with the code of v. A v between 0 and the smallest code becomes that one, so
  /// that no m is left without a v. A value above the largest code becomes that one. m is dropped
  /// where v is zero: it is below 1e-21 there. The code of NaN is undefined.
  static GS_HD HalfMoments of(float m, float v, std::uint32_t random) {
    std::uint32_t bits_of_m, bits_of_v;
    memcpy(&bits_of_m, &m, sizeof m);
    memcpy(&bits_of_v, &v, sizeof v);
    if (bits_of_v == 0) return {};
    const std::uint32_t kept = (bits_of_v + random_of_v(random)) >> kDroppedBitsOfV;
    const std::uint32_t code_of_v = kept <= kLeastV           ? 1
                                    : kept - kLeastV < kMostV ? kept - kLeastV
                                                              : kMostV;
    const std::uint32_t sign = bits_of_m >> 31 ? kSignOfM : 0;
    const std::uint32_t code_of_m =
        magnitude(bits_of_m & 0x7fffffff, exponent_of_steps(code_of_v), random_of_m(random));
    return {std::uint16_t(sign | code_of_m << kBitsOfV | code_of_v)};
  }

 private:
  // The random bits stand for the middle of those that share them, so that the mean is right.
  static GS_HD std::uint32_t random_of_v(std::uint32_t random) {
    constexpr int kRest = kDroppedBitsOfV - kRandomBitsOfV;
    return (random & ((1u << kRandomBitsOfV) - 1)) << kRest | 1u << (kRest - 1);
  }
  static GS_HD std::uint32_t random_of_m(std::uint32_t random) {
    constexpr int kRest = kDroppedBitsOfM - kRandomBitsOfM;
    return random >> (32 - kRandomBitsOfM) << kRest | 1u << (kRest - 1);
  }
  // k of |m| with these bits of a float: below 8 d a count of d, with 20 bits of its fraction; from
  // there on the upper bits of the float, counted from those of 8 d.
  static GS_HD std::uint32_t magnitude(std::uint32_t bits, std::uint32_t exponent_of_8d,
                                       std::uint32_t random) {
    const std::uint32_t exponent = bits >> 23;
    std::uint32_t k;
    if (exponent < exponent_of_8d) {
      const std::uint32_t below = exponent_of_8d - exponent;
      const std::uint32_t mantissa = (bits & 0x7fffff) | 0x800000;
      k = ((below < 32 ? mantissa >> below : 0) + random) >> kDroppedBitsOfM;
    } else {
      k = ((bits + random - (exponent_of_8d << 23)) >> kDroppedBitsOfM) + kNumbersInOctave;
    }
    return k < kMostM ? k : kMostM;
  }
};

GS_HD FloatMoments opened(HalfMoments code) {
  const std::uint32_t code_of_v = code.bits & HalfMoments::kMostV;
  const std::uint32_t k = code.bits >> HalfMoments::kBitsOfV & HalfMoments::kMostM;
  // Below 8 steps: what is left of 8 + k steps without 8, which is exact.
  const bool is_small = k < HalfMoments::kNumbersInOctave;
  const std::uint32_t base = HalfMoments::exponent_of_steps(code_of_v) << 23;
  const std::uint32_t bits_of_m =
      base + ((is_small ? k : k - HalfMoments::kNumbersInOctave) << HalfMoments::kDroppedBitsOfM);
  const std::uint32_t bits_of_v =
      code_of_v ? (code_of_v + HalfMoments::kLeastV) << HalfMoments::kDroppedBitsOfV : 0;
  float size, less, v;
  memcpy(&size, &bits_of_m, sizeof size);
  memcpy(&less, &base, sizeof less);
  memcpy(&v, &bits_of_v, sizeof v);
  if (is_small) size -= less;
  return {code.bits & HalfMoments::kSignOfM ? -size : size, v};
}
GS_HD void store(HalfMoments& to, const FloatMoments& moments, std::uint32_t random) {
  to = HalfMoments::of(moments.first, moments.second, random);
}

}  // namespace gs
