// SPDX-License-Identifier: Apache-2.0
// PNG files made on all threads, in a build with any libraries.
#pragma once

#include <cstdint>
#include <filesystem>
#include <string>
#include <vector>

#include "gs_core/image.h"

namespace gs {

/// The bytes of a PNG file with 1, 3 or 4 channels, the last of 4 straight alpha. They are the same
/// on every machine and with any number of threads.
///
/// xmp   metadata, as panorama_xmp() makes them; empty: none
std::vector<std::uint8_t> encode_png(const Image8& image, const std::string& xmp = {});

/// Writes them as a file, whole or not at all. Throws Error.
void write_png(const std::filesystem::path& path, const Image8& image, const std::string& xmp = {});

}  // namespace gs
