// SPDX-License-Identifier: Apache-2.0
// Stage 10: position along the Morton (Z-order) curve.   Morton 1966
#pragma once

#include "gs_core/math/constants.h"
#include "gs_core/math/spacetime/spacetime.h"
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

/// The interval in which a Gaussian in space and time lives, as a number below 2^(kMostTimeHalvings
/// + 1). A binary tree divides [0, 1] into 2^k intervals at level k; interval b of level k has the
/// number 2^k + b. The level is the first whose intervals are at most half as long as the scale in
/// time, so that Gaussians of one interval are seen in the same photos. Times outside [0, 1] are
/// moved there, and so is a NaN. (Faster-GS' 4D extension has 32 equal intervals.)
GS_HD std::uint32_t interval_of_life(float time_mean, float log_time_scale) {
  constexpr float kLog2 = 0.69314718f;
  int level = 0;
  while (level < kMostTimeHalvings && log_time_scale < float(1 - level) * kLog2) ++level;
  const float t = time_mean > 0.0f ? min_of(time_mean, 1.0f) : 0.0f;
  const int intervals = 1 << level;
  return std::uint32_t(intervals + min_of(int(t * float(intervals)), intervals - 1));
}

/// The Morton code of a Gaussian in space and time, with its interval of life as the highest bits;
/// as many of the lowest bits are lost.
GS_HD std::uint64_t spacetime_code(std::uint64_t code, float time_mean, float log_time_scale) {
  constexpr int kLifeBits = kMostTimeHalvings + 1;
  return std::uint64_t(interval_of_life(time_mean, log_time_scale))
             << (3 * kMortonBits - kLifeBits) |
         code >> kLifeBits;
}

}  // namespace gs
