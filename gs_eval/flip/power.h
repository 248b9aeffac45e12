// SPDX-License-Identifier: Apache-2.0
// Powers without branches and calls, so that loops over the pixels of a row are vectorized. They
// have the same bits on every machine.
#pragma once

#include <algorithm>
#include <bit>
#include <cstdint>

namespace gs {

inline constexpr int kMantissaBits = 52;                             // of a double
inline constexpr std::uint64_t kOneBits = 0x3ff0'0000'0000'0000ull;  // of 1.0

/// The logarithm to base 2 of a normal number above 0; -1023 of 0. Off by less than 1e-12.
inline double log2_of(double x) {
  constexpr std::uint64_t kRootOfHalfBits = 0x3fe6'a09e'667f'3bcdull;
  constexpr std::uint64_t kWholeBits = 0x4330'0000'0000'0000ull;  // of 2^52, behind which n adds n
  constexpr double kBias = 4503599627370496.0 + 1023;
  constexpr double kTwoByLog2 = 2.8853900817779268;  // 2 / ln 2
  const std::uint64_t bits = std::bit_cast<std::uint64_t>(x);
  // x = 2^exponent m, m from sqrt(1/2) to sqrt(2)
  const std::uint64_t biased = (bits + (kOneBits - kRootOfHalfBits)) >> kMantissaBits;
  const double exponent = std::bit_cast<double>(biased | kWholeBits) - kBias;
  const double m = std::bit_cast<double>(bits - (biased << kMantissaBits) + kOneBits);
  const double s = (m - 1) / (m + 1), z = s * s;  // ln m = 2 (s + s^3 / 3 + s^5 / 5 + ...)
  const double series =
      1 + z * (1.0 / 3 + z * (1.0 / 5 + z * (1.0 / 7 + z * (1.0 / 9 + z * (1.0 / 11 + z / 13)))));
  return exponent + kTwoByLog2 * s * series;
}

/// 2^x for x up to 1023, off by less than 1e-12 of it; 2^-1022 for any x below -1022.
inline double exp2_of(double x) {
  constexpr double kRound = 6755399441055744.0;  // 1.5 * 2^52: adding it rounds to a whole number
  constexpr double kLog2 = 0.69314718055994531;
  const double at = std::max(x, -1022.0), shifted = at + kRound, n = shifted - kRound;
  const double y = (at - n) * kLog2;
  constexpr double kFactors[] = {
      1.0 / 3628800, 1.0 / 362880, 1.0 / 40320, 1.0 / 5040, 1.0 / 720, 1.0 / 120,
      1.0 / 24,      1.0 / 6,      1.0 / 2,     1,          1};
  double series = 0;  // e^y = 1 + y + y^2 / 2 + y^3 / 6 + ...
  for (const double factor : kFactors) series = series * y + factor;
  const std::uint64_t power = (std::bit_cast<std::uint64_t>(shifted) << kMantissaBits) + kOneBits;
  return series * std::bit_cast<double>(power);
}

/// base^exponent for a base of at least 0; in place of 0, a number below 1e-90 where the exponent is
/// above 0.3.
inline double power_of(double base, double exponent) { return exp2_of(exponent * log2_of(base)); }

}  // namespace gs
