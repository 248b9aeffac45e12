// SPDX-License-Identifier: Apache-2.0
// Pictures of four bytes a pixel as lossless WebP. In a build without libwebp, the functions throw
// an Error that says so.
#pragma once

#include <filesystem>
#include <string>
#include <string_view>

#include "gs_core/image.h"

namespace gs {

inline constexpr int kWebpLargestSide = 16383;  // pixels

/// Throws Error that says what to install where this build lacks libwebp.
void require_webp();

/// A picture of 4 channels, exact to the last bit, colors of transparent pixels included.
std::string webp_of(const Image8& rgba);

/// The picture, 4 channels. Throws Error "cannot read PATH: ..." that names `entry` where it is
/// damaged or has more than `most_pixels` pixels.
Image8 read_webp(const std::filesystem::path& path, const std::string& entry,
                 std::string_view bytes, std::size_t most_pixels);

}  // namespace gs
