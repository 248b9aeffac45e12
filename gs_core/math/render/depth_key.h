// SPDX-License-Identifier: Apache-2.0
// Stage 2: the key by which visible Gaussians are sorted.
#pragma once

#include <cstring>

#include "gs_core/math/constants.h"
#include "gs_core/types.h"

namespace gs {

/// The conversion of depths to sorting keys.
struct DepthKeys {
  std::uint32_t near_bits;
  int shift;
};

GS_HD std::uint32_t bits_of(float x) {
  std::uint32_t bits;
  memcpy(&bits, &x, sizeof bits);
  return bits;
}

/// Keys for depths in near .. far. Positive floats are ordered as their bits are, and the key is
/// the highest of these bits that fit into kDepthKeyBits. It distinguishes depths that differ by
/// some 1e-6 of their size (Faster-GS sorts all 32 bits). The largest key belongs to no depth: it
/// marks Gaussians that are not drawn.
inline DepthKeys depth_keys(float near_plane, float far_plane) {
  DepthKeys keys{bits_of(near_plane), 0};
  const std::uint32_t range = bits_of(far_plane) - keys.near_bits;
  while (range >> keys.shift >= (1u << kDepthKeyBits) - 1) ++keys.shift;
  return keys;
}

/// The key of a depth in near .. far; equal keys are drawn in the order of the Gaussians.
GS_HD std::uint32_t depth_key(const DepthKeys& keys, float depth) {
  return (bits_of(depth) - keys.near_bits) >> keys.shift;
}

}  // namespace gs
