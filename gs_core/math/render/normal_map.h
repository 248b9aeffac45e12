// SPDX-License-Identifier: Apache-2.0
// Normals that somebody gives for the pixels of a photo: a prior of its surfaces
// (docs/method/surfaces.md).
#pragma once

#include <cstddef>
#include <cstdint>

#include "gs_core/types.h"

namespace gs {

/// A normal in a byte each, in the camera's axes x right, y down, z forward:
///
///   byte = 128 + 127 n;   all 0 where nothing is known
///
/// They are off by some 0.2 degrees, and take as much memory as the photo.
struct NormalBytes {
  std::uint8_t x = 0, y = 0, z = 0;

  GS_HD bool is_known() const { return x > 0; }
  GS_HD Vec3f normal() const {
    return Vec3f(float(x) - 128, float(y) - 128, float(z) - 128) / 127.0f;
  }
};
/// `n` has a length of 1.
inline NormalBytes bytes_of_normal(const Vec3f& n) {
  const auto byte = [](float value) { return std::uint8_t(128.5f + 127 * value); };
  return {byte(n.x), byte(n.y), byte(n.z)};
}

/// The map of a photo that is reduced so many times.
struct NormalMap {
  const std::uint8_t* pixels =
      nullptr;    // (height, width, 3) of the whole photo; null: there is none
  int width = 0;  // of the whole photo, in pixels
  int reduction = 1;

  /// The mean of the known normals of a block, which is shorter than 1 where they differ; not known
  /// where less than half of them are.
  GS_HD NormalBytes at(int x, int y) const {
    std::uint32_t sums[3] = {0, 0, 0}, known = 0;
    for (int row = y * reduction; row < (y + 1) * reduction; ++row)
      for (int column = x * reduction; column < (x + 1) * reduction; ++column) {
        const std::uint8_t* const pixel =
            pixels + 3 * (std::size_t(row) * std::size_t(width) + std::size_t(column));
        if (pixel[0] == 0) continue;
        for (int c = 0; c < 3; ++c) sums[c] += pixel[c];
        ++known;
      }
    if (known == 0 || 2 * known < std::uint32_t(reduction * reduction)) return {};
    const auto mean = [&](int c) { return std::uint8_t((sums[c] + known / 2) / known); };
    return {mean(0), mean(1), mean(2)};
  }
};

}  // namespace gs
