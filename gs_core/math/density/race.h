// SPDX-License-Identifier: Apache-2.0
// Draws without replacement, with a probability in proportion to a score. Each row gets a key; the
// rows with the k smallest keys are drawn. A key depends on the row's own random bits and score
// alone and is computed without rounding that differs between machines, so that the CPU and the
// GPU draw the same rows.   Efraimidis & Spirakis 2006, "Weighted random sampling with a reservoir"
#pragma once

#include "gs_core/math/random.h"

#ifndef __CUDA_ARCH__
#include <bit>
#endif

namespace gs {

inline constexpr int kLog2FractionBits = 40;
inline constexpr std::uint64_t kNeverDrawn = ~std::uint64_t(0);

/// -log2((bits + 1) / 2^64) in units of 2^-40, rounded up: 0 for the largest `bits`, 64 * 2^40 for 0.
///
/// One squaring of the mantissa yields one binary digit of the logarithm. Integers only.
GS_HD std::uint64_t minus_log2(std::uint64_t bits) {
  std::uint64_t mantissa = bits + 1;
  if (mantissa == 0) return 0;  // 2^64
  int zeros = 0;                // in front of it
  for (int step = 32; step > 0; step /= 2)
    if (mantissa >> (64 - step) == 0) {
      mantissa <<= step;
      zeros += step;
    }
  std::uint64_t fraction = 0;  // of log2, by the mantissa / 2^63 in [1, 2)
  for (int digit = 0; digit < kLog2FractionBits; ++digit) {
    const std::uint64_t square = high_product(mantissa, mantissa);  // / 2^62
    const bool is_two_or_more = square >> 63;
    mantissa = is_two_or_more ? square : square << 1;
    fraction = fraction << 1 | std::uint64_t(is_two_or_more);
  }
  return (std::uint64_t(zeros + 1) << kLog2FractionBits) - fraction;
}

/// The bits of a positive double are ordered as the doubles are.
GS_HD std::uint64_t ordered_bits(double positive) {
#ifdef __CUDA_ARCH__
  return std::uint64_t(__double_as_longlong(positive));
#else
  return std::bit_cast<std::uint64_t>(positive);
#endif
}

inline constexpr std::uint64_t kInfinityBits = 0x7ff0000000000000;  // of a double

/// False for scores that cannot be drawn: 0, below, infinite, NaN.
GS_HD bool has_score(double score) { return score > 0 && ordered_bits(score) < kInfinityBits; }

/// A key for a draw in proportion to the score: an exponentially distributed time, -log2 u / score,
/// at which the row arrives. The first k rows to arrive are the draw.
GS_HD std::uint64_t race_key(std::uint64_t bits, double score) {
  if (!has_score(score)) return kNeverDrawn;
  return ordered_bits(double(minus_log2(bits) + 1) / score);
}

/// A key that is smaller for a larger score.
GS_HD std::uint64_t top_key(double score) {
  return has_score(score) ? kInfinityBits - ordered_bits(score) : kNeverDrawn;
}

}  // namespace gs
