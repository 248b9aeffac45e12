// SPDX-License-Identifier: Apache-2.0
// What reading and writing .gs4d share.
#pragma once

#include <array>
#include <cstdint>

#include "gs_core/gaussians.h"

namespace gs {

inline constexpr std::uint32_t kGs4dMagic = 0x44345347;  // "GS4D"
inline constexpr std::uint32_t kGs4dVersion = 1;
inline constexpr std::size_t kGs4dChunk = 32768;  // Gaussians in a chunk, at most: about 1 MB
inline constexpr std::size_t kGs4dBlock = 256;    // Gaussians with common ranges
inline constexpr std::uint8_t kGs4dAntialiased = 1;
inline constexpr float kGs4dNever = 2;  // begin and end of a chunk that is never drawn
inline constexpr int kGs4dRotationSteps = 511;

struct Gs4dHeader {
  std::uint32_t magic = kGs4dMagic, version = kGs4dVersion, count = 0, chunks = 0;
  std::uint8_t sh_degree = 0, flags = 0;
  std::uint16_t reserved = 0;
  float duration = 0;
  std::uint32_t more[2] = {};
};
static_assert(sizeof(Gs4dHeader) == 32);

struct Gs4dChunk {
  std::uint32_t count = 0, bytes = 0;
  float begin = kGs4dNever, end = kGs4dNever;
};
static_assert(sizeof(Gs4dChunk) == 16);

/// The range of a quantity: value = low + step * integer.
struct Gs4dRange {
  float low = 0, step = 0;
  float value(std::uint32_t integer) const { return low + step * float(integer); }
};
struct Gs4dBlock {
  Vec3f position_low, position_step, drift_step;
  Gs4dRange time_mean, log_time_scale, log_scale, sh0;
  float sh_step = 0;
};
static_assert(sizeof(Gs4dBlock) == 18 * sizeof(float));

/// Where the arrays of a chunk begin, in bytes from its own beginning.
struct Gs4dArrays {
  std::size_t rotations, positions, drifts, times, scales, opacities, colors, sh, end;

  Gs4dArrays(std::size_t count, int sh_degree) {
    rotations = (count + kGs4dBlock - 1) / kGs4dBlock * sizeof(Gs4dBlock);
    positions = rotations + 4 * count;
    drifts = positions + 6 * count;
    times = drifts + 6 * count;
    scales = times + 4 * count;
    opacities = scales + 3 * count;
    colors = opacities + count;
    sh = colors + 3 * count;
    end = sh + 3 * std::size_t(sh_rest_count(sh_degree)) * count;
  }
};

}  // namespace gs
