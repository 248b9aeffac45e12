// SPDX-License-Identifier: Apache-2.0
// Stage 10: position along the Morton (Z-order) curve.   Morton 1966
#pragma once

#include "gs_core/math/constants.h"
#include "gs_core/math/spacetime.h"
#include "gs_core/types.h"

namespace gs {

/// Spreads the low 21 bits of v so that two zero bits follow each.
GS_HD std::uint64_t spread_bits(std::uint64_t v) {
  v &= 0x1fffff;
  v = (v | v << 32) & 0x001f00000000ffffull;
  v = (v | v << 16) & 0x001f0000ff0000ffull;
  v = (v | v << 8) & 0x100f00f00f00f00full;
  v = (v | v << 4) & 0x10c30c30c30c30c3ull;
  v = (v | v << 2) & 0x1249249249249249ull;
  return v;
}

/// Morton code of a point in a cube; x gives the lowest bits. Points outside are moved to its
/// surface, and so is a NaN.
///
/// low   the cube's smallest corner   world units
/// size  its edge length, > 0         world units
GS_HD std::uint64_t morton_code(const Vec3f& point, const Vec3f& low, float size) {
  constexpr float kSteps = float((1 << kMortonBits) - 1);
  const auto cell = [&](float p, float from) {
    const float t = (p - from) / size;
    return std::uint64_t((t > 0.0f ? min_of(t, 1.0f) : 0.0f) * kSteps);
  };
  return spread_bits(cell(point.x, low.x)) | spread_bits(cell(point.y, low.y)) << 1 |
         spread_bits(cell(point.z, low.z)) << 2;
}

/// The code with the bin of a time as its highest bits, so that Gaussians of one moment are
/// neighbors in memory; as many of its lowest bits are lost. Times outside [0, 1] are moved there,
/// and so is a NaN.   Faster-GS, 4D
GS_HD std::uint64_t time_binned(std::uint64_t code, float time) {
  const float t = time > 0.0f ? min_of(time, 1.0f) : 0.0f;
  const auto bin =
      std::uint64_t(min_of(int(t * float(1 << kTimeBinBits)), (1 << kTimeBinBits) - 1));
  return bin << (3 * kMortonBits - kTimeBinBits) | code >> kTimeBinBits;
}

inline constexpr int kSpacetimeCodeBits = 3 * kMortonBits + 1;
/// The code of a Gaussian in space and time: in the bin of its time, or behind all bins if it is
/// static, so that a warp has static ones or others.
GS_HD std::uint64_t spacetime_code(std::uint64_t code, float time_mean, float log_time_scale) {
  if (is_static(log_time_scale)) return std::uint64_t(1) << (kSpacetimeCodeBits - 1) | code;
  return time_binned(code, time_mean);
}

}  // namespace gs
