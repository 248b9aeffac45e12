// SPDX-License-Identifier: Apache-2.0
// What a picture promises, read from its header by us. Decoders ask for memory when they open a
// file, before anyone could look at its size: 97 bytes of GIF take 2 GB, 527 bytes of JPEG or 377
// of EXR as much.
#pragma once

#include <cstdint>
#include <filesystem>

namespace gs {

inline constexpr std::int64_t kMostPixels = std::int64_t(1) << 29;  // more is a damaged header

/// Of JPEG, PNG, GIF, TIFF, BMP, WebP, JPEG 2000, HEIF and EXR. Other formats take no memory on
/// opening.
struct PictureHeader {
  std::uint64_t width = 0,
                height = 0;           // pixels, the largest of picture, canvas and tile; 0: unknown
  std::uint64_t bytes_per_pixel = 0;  // in memory while it is decoded
  std::uint64_t file_bytes = 0;
  std::uint64_t scans = 1;         // passes over all pixels, of a progressive JPEG
  std::uint64_t packed_texts = 0;  // compressed notes, which unpack to megabytes each, of a PNG
  bool is_damaged = false;         // a part of an EXR's header has another length than its kind
  bool is_photo_format = true;     // GIF is not: no large picture is a GIF
};

/// Reads the header. Throws Error for a file that is missing or not a regular one.
PictureHeader read_picture_header(const std::filesystem::path& path);

/// Throws Error, which names the file, for a picture that would take more memory or time than a
/// file of its size can be worth. Call it before a decoder opens the file.
void check_picture(const std::filesystem::path& path, const PictureHeader& header);

}  // namespace gs
