// SPDX-License-Identifier: Apache-2.0
// Stage 8: both of Adam's moments of one number in 16 bits: v as a small float, and m in steps that
// depend on the size of v.
#pragma once

#include <cstring>

#include "gs_core/types.h"

namespace gs {

/// Both moments of one number: the sign of m, 6 bits of its size, and 9 bits of v.
///
///   v = 0 for the code 0, else (1 + (c mod 4) / 4) 2^(floor(c / 4) - 100)        c = 1 .. 511
///   |m| = n d,  d = 2^(floor(c / 8) - 56)                                        k = 0 .. 63
///   n   = k for k < 8, else (8 + k mod 8) 2^(floor(k / 8) - 1)                   up to 960
///
/// So v has four codes an octave from 1.25 2^-100, whose root is Adam's epsilon, to 1.75 2^27.
/// sqrt(v) lies in [64 d, 120 d). Up to |m| = 16 d its steps are d, and from there on 1/16 to 1/8
/// of |m|. The largest |m| is 960 d, between 8 and 15 sqrt(v).
/// All of it is arithmetic of integers, so that every processor has the same bits.
struct TinyCode {
  std::uint16_t bits = 0;

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

  /// The code of m and v >= 0, each rounded at random (moment_code.h), m in the steps that go with
  /// the code of v. A v between 0 and the smallest code becomes that one, so that no m is left
  /// without a v; what is above the largest code of either becomes that. m is dropped where v is
  /// zero: it is below 1e-21 there. What NaN becomes is undefined.
  static GS_HD TinyCode of(float m, float v, std::uint32_t random) {
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

GS_HD float first_moment(TinyCode code) {
  const std::uint32_t exponent = TinyCode::exponent_of_steps(code.bits & TinyCode::kMostV);
  const std::uint32_t k = code.bits >> TinyCode::kBitsOfV & TinyCode::kMostM;
  // Below 8 steps: what is left of 8 + k steps without 8, which is exact.
  const bool is_small = k < TinyCode::kNumbersInOctave;
  const std::uint32_t base = exponent << 23;
  const std::uint32_t bits =
      base + ((is_small ? k : k - TinyCode::kNumbersInOctave) << TinyCode::kDroppedBitsOfM);
  float size, less;
  memcpy(&size, &bits, sizeof size);
  memcpy(&less, &base, sizeof less);
  if (is_small) size -= less;
  return code.bits & TinyCode::kSignOfM ? -size : size;
}
GS_HD float second_moment(TinyCode code) {
  const std::uint32_t code_of_v = code.bits & TinyCode::kMostV;
  const std::uint32_t bits =
      code_of_v ? (code_of_v + TinyCode::kLeastV) << TinyCode::kDroppedBitsOfV : 0;
  float v;
  memcpy(&v, &bits, sizeof v);
  return v;
}

}  // namespace gs
