// SPDX-License-Identifier: Apache-2.0
#include "gs_model/formats/coding/half.h"

#include <algorithm>
#include <bit>
#include <cmath>

namespace gs {

// Rounds to the nearest, ties to even, by adding half of the last kept bit.
std::uint16_t to_half(float value) {
  const std::uint32_t bits = std::bit_cast<std::uint32_t>(value), sign = bits >> 16 & 0x8000;
  const float size = std::abs(value);
  if (size >= 65504) return std::uint16_t(sign | 0x7bff);
  if (size < 0x1p-14f)  // too small for an exponent: multiples of 2^-24
    return std::uint16_t(sign | std::uint32_t(std::lrint(size * 0x1p24f)));
  const std::uint32_t kept = (bits & 0x7fffffff) - (112u << 23);
  return std::uint16_t(sign |
                       std::min<std::uint32_t>((kept + 0xfff + (kept >> 13 & 1)) >> 13, 0x7bff));
}

float from_half(std::uint16_t half) {
  const int exponent = half >> 10 & 31, fraction = half & 1023;
  const float sign = half & 0x8000 ? -1.0f : 1.0f;
  if (exponent == 31) return fraction ? NAN : sign * INFINITY;
  return sign * (exponent ? std::ldexp(float(1024 + fraction), exponent - 25)
                          : std::ldexp(float(fraction), -24));
}

}  // namespace gs
