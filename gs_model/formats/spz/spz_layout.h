// SPDX-License-Identifier: Apache-2.0
// What reading and writing .spz share.
#pragma once

#include <array>
#include <cstdint>

#include "gs_core/gaussians.h"

namespace gs {

inline constexpr std::uint32_t kSpzMagic = 0x5053474E;  // "NGSP"
inline constexpr std::size_t kSpzHeaderBytes = 16;      // versions 2 and 3
inline constexpr std::size_t kSpzArrays = 6;  // positions, alphas, colors, scales, rotations, sh
inline constexpr std::uint8_t kSpzAntialiased = 1, kSpzExtensions = 2;
inline constexpr int kSpzMaxDegree = 4;

/// The first 16 bytes. In version 4 `last` is the number of streams.
struct SpzHeader {
  std::uint32_t magic = kSpzMagic, version = 3, count = 0;
  std::uint8_t sh_degree = 0, fractional_bits = 12, flags = 0, last = 0;
};
static_assert(sizeof(SpzHeader) == kSpzHeaderBytes);

/// The rest of version 4's header.
struct SpzStreamTable {
  std::uint32_t offset = kSpzHeaderBytes + 16;  // bytes from the file's beginning
  std::uint32_t reserved[3] = {};
};
static_assert(sizeof(SpzStreamTable) == 16);
struct SpzStream {
  std::uint64_t packed = 0, raw = 0;  // bytes
};

/// Bytes of a Gaussian in positions, alphas, colors, scales, rotations, sh.
inline std::array<std::size_t, kSpzArrays> spz_row_bytes(std::uint32_t version, int sh_degree) {
  return {9, 1, 3, 3, version == 2 ? 3u : 4u, 3 * std::size_t(sh_rest_count(sh_degree))};
}

// Units of the arrays, per unit of what they hold.
inline constexpr float kSpzColorSteps = 0.15f * 255, kSpzColorZero = 127.5f;
inline constexpr float kSpzScaleSteps = 16, kSpzLeastLogScale = -10;
inline constexpr float kSpzShSteps = 128, kSpzShZero = 128;
inline constexpr std::uint32_t kSpzRotationSteps = 511;  // for 1/sqrt(2)

}  // namespace gs
