// SPDX-License-Identifier: Apache-2.0
// JPEG photos with an EXIF part of given bytes.
#pragma once

#include <cstdint>
#include <string>
#include <vector>

#include "data_loaders/photos/photos.h"

namespace gs {

/// The EXIF part of a JPEG (APP1) that holds this TIFF.
inline std::string exif_segment(const std::string& tiff) {
  const std::size_t length = 2 + 6 + tiff.size();
  return std::string("\xff\xe1") + char(length >> 8) + char(length & 255) +
         std::string("Exif\0\0", 6) + tiff;
}

/// The bytes of a gray JPEG with that part.
inline std::string gray_photo_with_exif(int width, int height, const std::string& tiff) {
  const std::vector<std::uint8_t> jpeg = encode_jpeg(Image8(width, height, 3, 128), 90);
  std::string bytes(jpeg.begin(), jpeg.end());
  return bytes.insert(2, exif_segment(tiff));
}

}  // namespace gs
