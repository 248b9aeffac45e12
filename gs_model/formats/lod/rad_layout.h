// SPDX-License-Identifier: Apache-2.0
// What reading and writing .rad share.
#pragma once

#include <cstddef>
#include <cstdint>

namespace gs {

inline constexpr std::uint32_t kRadMagic = 0x30444152, kRadChunkMagic = 0x43444152;  // RAD0, RADC
inline constexpr std::size_t kRadChunk = 65536;  // Gaussians: a page of Spark's textures

/// Numbers of "sh1", "sh2" and "sh3", and the first of their coefficients in ShRest.
struct RadBand {
  const char* property;
  int first, coefficients;
};
inline constexpr RadBand kRadBands[] = {{"sh1", 0, 3}, {"sh2", 3, 5}, {"sh3", 8, 7}};

/// Zeros behind so many bytes, up to a multiple of 8.
inline std::size_t rad_padding(std::size_t bytes) { return (8 - bytes % 8) % 8; }

}  // namespace gs
