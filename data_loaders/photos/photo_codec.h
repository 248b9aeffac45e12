// SPDX-License-Identifier: Apache-2.0
// The part of a codec library that photos.cpp needs. CMake chooses between photo_codec_oiio.cpp and
// photo_codec_stb.cpp.
#pragma once

#include <cstdint>
#include <filesystem>
#include <optional>
#include <string>
#include <vector>

#include "data_loaders/photos/map_file.h"
#include "data_loaders/photos/photos.h"

namespace gs {

/// Throws Error: cannot read photo FILE: `what`.
[[noreturn]] void cannot_read_photo(const std::filesystem::path& path, const std::string& what);

/// Throws AccessError: cannot read photo FILE, for the reason that errno has.
[[noreturn]] void cannot_access_photo(const std::filesystem::path& path);

/// Throws Error for sizes that no photo has.
void check_photo_size(const std::filesystem::path& path, const PhotoSize& size);

/// A file that exists, decoded in stored order to 1 to 4 channels: gray, gray and alpha, color, or
/// color and alpha. Throw Error for anything but a whole photo.
Image8 decode_photo(const std::filesystem::path& path);
/// A file that exists: the channels that the kind reads.
MapFile decode_map(const MapKind& kind, const std::filesystem::path& path);
PhotoSize decode_photo_size(const std::filesystem::path& path);
int decode_photo_orientation(const std::filesystem::path& path);
std::optional<Geodetic> decode_photo_place(const std::filesystem::path& path);
/// The tags of EXIF that say how a photo was exposed; 0 for one that is missing.
struct ExposureTags {
  double seconds = 0, f_number = 0, iso = 0;
};
ExposureTags decode_exposure_tags(const std::filesystem::path& path);

/// The result of decode_photo() as color and alpha.
PhotoWithAlpha separated(Image8 decoded);
/// Color with a fourth channel of the same size: an alpha or a mask.
Image8 joined(const Image8& color, const Image8& fourth);

/// The library and its version: another one may decode a JPEG to other bytes.
std::string codec_name();

/// The bytes of a JPEG file of such quality that no loss is seen, for a copy of a photo. It has the
/// EXIF tags of the photo, and an orientation that says upright. `image` has three channels.
std::vector<std::uint8_t> encode_jpeg_copy(const std::filesystem::path& photo, const Image8& image);
inline constexpr int kCopyQuality = 98;

}  // namespace gs
