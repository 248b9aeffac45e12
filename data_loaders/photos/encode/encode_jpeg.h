// SPDX-License-Identifier: Apache-2.0
// JPEGs of three channels for viewing, not for measuring.
#pragma once

#include <cstdint>
#include <vector>

#include "gs_core/image.h"

namespace gs {

/// The bytes of a JPEG file; quality 1 to 100. Large ones are made on all threads. Throws Error.
std::vector<std::uint8_t> encode_jpeg(const Image8& image, int quality);

/// The same on one thread. Libraries implement it: encode_jpeg_libjpeg.cpp, encode_jpeg_stb.cpp and
/// ../photo_codec_oiio.cpp.
std::vector<std::uint8_t> encode_jpeg_alone(const Image8& image, int quality);

}  // namespace gs
