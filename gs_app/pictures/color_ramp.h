// SPDX-License-Identifier: Apache-2.0
// Numbers as colors: errors beside pictures, depth in pictures of its own.
#pragma once

#include <array>
#include <cstdint>

namespace gs {

using Rgb = std::array<std::uint8_t, 3>;  // display sRGB

/// Of even steps in lightness: black, violet, red, orange, pale yellow.
const std::array<Rgb, 256>& color_ramp();

}  // namespace gs
