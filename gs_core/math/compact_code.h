// SPDX-License-Identifier: Apache-2.0
// Stage 8: both of Adam's moments of one number in 32 bits, as pieces of floats.
#pragma once

#include <cstring>

#include "gs_core/types.h"

namespace gs {

/// Both moments of one number. The upper 16 bits are the first 16 of the float m: sign, exponent
/// and 7 bits of the mantissa. The lower 16 bits are those of the float v without its sign:
/// exponent and 8 bits of the mantissa. Both have the whole range of a float, and zero is exact.
struct CompactCode {
  std::uint32_t bits = 0;

  static constexpr int kDroppedBitsOfM = 16, kDroppedBitsOfV = 15;

  /// The codes of m and v >= 0, each rounded at random (moment_code.h). Floats of one sign are
  /// ordered as their bits are, so that this is one addition below the bits that are kept. m and v
  /// use different bits of `random`. What NaN becomes is undefined.
  static GS_HD CompactCode of(float m, float v, std::uint32_t random) {
    std::uint32_t bits_of_m, bits_of_v;
    memcpy(&bits_of_m, &m, sizeof m);
    memcpy(&bits_of_v, &v, sizeof v);
    bits_of_m += random >> (32 - kDroppedBitsOfM);
    bits_of_v += random & ((1u << kDroppedBitsOfV) - 1);
    return {(bits_of_m & 0xffff0000u) | (bits_of_v >> kDroppedBitsOfV & 0xffffu)};
  }
};

GS_HD float first_moment(CompactCode code) {
  const std::uint32_t bits = code.bits & 0xffff0000u;
  float m;
  memcpy(&m, &bits, sizeof m);
  return m;
}
GS_HD float second_moment(CompactCode code) {
  const std::uint32_t bits = (code.bits & 0xffffu) << CompactCode::kDroppedBitsOfV;
  float v;
  memcpy(&v, &bits, sizeof v);
  return v;
}

}  // namespace gs
