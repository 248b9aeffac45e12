// SPDX-License-Identifier: Apache-2.0
// What reading and writing .sog share.
#pragma once

#include <cmath>
#include <cstdint>

namespace gs {

inline constexpr int kSogVersion = 2;
inline constexpr std::size_t kSogCodebook = 256;       // entries
inline constexpr std::size_t kSogPaletteColumns = 64;  // palette entries in a row of its picture
inline constexpr std::size_t kSogLargestPalette = 65536;
inline constexpr std::uint8_t kSogRotationTag = 252;  // alpha of quats: this + the left-out one

/// Positions are spread evenly in this: fine near the origin, coarse far away.
inline float sog_log(float x) { return std::copysign(std::log1p(std::abs(x)), x); }
inline float sog_exp(float x) { return std::copysign(std::expm1(std::abs(x)), x); }

}  // namespace gs
