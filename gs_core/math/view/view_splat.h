// SPDX-License-Identifier: Apache-2.0
// Splats of 32 bytes for frames without a backward pass: one sector of memory instead of two. The
// factors of the conic and the logarithm of the opacity, which blending needs, are computed once
// and not for each tile. Colors have 17 significant bits.
#pragma once

#include <cstring>

#include "gs_core/math/render/blend.h"
#include "gs_core/math/render/splat.h"

namespace gs {

/// A channel of a color as a number of 21 bits without a sign: 5 of the exponent and 16 of the
/// mantissa, from 2^-39 to 256. Negative channels are blended as 0.
inline constexpr int kChannelBits = 21;
inline constexpr float kMostChannel = 255.998046875f;  // (2 - 2^-16) 2^7
// A float has 127 as the exponent of 1, these numbers 24.
inline constexpr float kChannelScale = 0x1p-103f, kChannelUnscale = 0x1p103f;
inline constexpr int kDroppedBits = 23 - 16;  // of the float's mantissa

GS_HD std::uint32_t packed_channel(float channel) {
  const float scaled = clamp_to(channel, 0.0f, kMostChannel) * kChannelScale;
  std::uint32_t bits;
  memcpy(&bits, &scaled, sizeof bits);
  return (bits + (1u << (kDroppedBits - 1))) >> kDroppedBits;
}
GS_HD float unpacked_channel(std::uint32_t packed) {
  const std::uint32_t bits = (packed & ((1u << kChannelBits) - 1)) << kDroppedBits;
  float scaled;
  memcpy(&scaled, &bits, sizeof scaled);
  return scaled * kChannelUnscale;
}

/// Three channels in 63 bits, red in the lowest.
struct PackedColor {
  std::uint32_t low, high;
};
GS_HD PackedColor packed_color(const Vec3f& color) {
  const std::uint32_t red = packed_channel(color.x), green = packed_channel(color.y),
                      blue = packed_channel(color.z);
  return {red | green << kChannelBits,
          green >> (32 - kChannelBits) | blue << (2 * kChannelBits - 32)};
}
GS_HD Vec3f unpacked_color(const PackedColor& color) {
  return {unpacked_channel(color.low),
          unpacked_channel(color.low >> kChannelBits | color.high << (32 - kChannelBits)),
          unpacked_channel(color.high >> (2 * kChannelBits - 32))};
}

/// A splat as blending on tensor cores reads it, under Truncation::alpha.
struct alignas(16) ViewSplat {
  Vec2f mean2d;           // pixels
  ConicFactors<float> L;  // 1 / pixels
  float log2_opacity;     // log2(255 opacity), >= 0
  PackedColor color;      // clamped to 0 from below
};
static_assert(sizeof(ViewSplat) == 32);

GS_HD ViewSplat view_splat(const Splat& splat) {
  return {splat.mean2d, conic_factors(splat.conic, splat.variance_y), float(kLog2E) * splat.cutoff,
          packed_color(splat.color)};
}

/// What decides which tiles a splat hits.
struct SplatOutline {
  Vec2f mean2d;       // pixels
  Sym2<float> conic;  // 1 / pixels^2
  float cutoff;       // a fragment is kept iff its exponent >= -cutoff
};
GS_HD SplatOutline outline_of(const Splat& splat) {
  return {splat.mean2d, splat.conic, splat.cutoff};
}
/// The outline of a packed splat, which is that of its splat to rounding. Where tiles are counted
/// and where they are listed it must be computed from the same packed splat.
GS_HD SplatOutline outline_of(const ViewSplat& splat) {
  return {splat.mean2d, conic_of(splat.L), float(kLn2) * splat.log2_opacity};
}

}  // namespace gs
