// SPDX-License-Identifier: Apache-2.0
// The color ramp for numbers in pictures: errors and depths.
#pragma once

#include <array>
#include <cstdint>

namespace gs {

using Rgb = std::array<std::uint8_t, 3>;  // display sRGB

/// 256 colors with even steps in lightness: black, violet, red, orange, pale yellow.
const std::array<Rgb, 256>& color_ramp();

}  // namespace gs
