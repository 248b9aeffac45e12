// SPDX-License-Identifier: Apache-2.0
// The EXIF orientation of a photo: how its stored pixels are to be turned, so that up is up.
#pragma once

#include <filesystem>

#include "data_loaders/photos/photos.h"

namespace gs {

/// The size of a photo once it stands upright. Orientations 5 to 8 swap width and height.
PhotoSize upright_size(const PhotoSize& stored, int orientation);

/// The picture, turned and mirrored as its EXIF orientation (1 to 8; EXIF 2.3, 4.6.4 A) says.
Image8 upright(const Image8& stored, int orientation);

/// The inverse of upright(): an upright picture in the order in which the photo's pixels are stored.
Image8 as_stored(const Image8& upright, int orientation);

/// The size of a picture that is turned(), and the picture itself: clockwise, by 0, 90, 180 or 270
/// degrees.
PhotoSize turned_size(const PhotoSize& size, int degrees);
Image8 turned(const Image8& image, int degrees);

/// The photo upright, with alpha as a fourth channel if the file has it. Throws Error like
/// read_photo().
Image8 read_upright(const std::filesystem::path& photo);

/// Writes what read_upright() gave, for programs that follow no EXIF orientation or do not read the
/// photo's format: as a JPEG of high quality if `copy` ends in .jpg or .jpeg, else as a PNG. A JPEG
/// keeps the photo's EXIF tags and has no alpha. Throws Error like write_png().
void write_copy(const std::filesystem::path& photo, const Image8& upright,
                const std::filesystem::path& copy);

}  // namespace gs
