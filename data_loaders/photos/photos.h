// SPDX-License-Identifier: Apache-2.0
// Reads photos, and makes them smaller. Pixels are read as COLMAP reads them: in stored
// order, without following an EXIF orientation.
#pragma once

#include <filesystem>
#include <optional>
#include <string>

#include "gs_core/geodesy/geodetic.h"
#include "gs_core/image.h"

namespace gs {

struct PhotoSize {
  int width = 0, height = 0;  // pixels, in stored order
};

/// Decodes a photo to (height, width, 3). Gray is repeated into three channels, alpha is dropped
/// (color values stay as stored), more than 8 bits are rounded. Throws Error that names the file
/// when it is missing, of an unknown format, damaged or cut short.
Image8 read_photo(const std::filesystem::path& path);

/// A photo and its alpha, if the file has one.
struct PhotoWithAlpha {
  Image8 photo;  // (height, width, 3) as read_photo() gives it
  Image8 alpha;  // (height, width, 1); empty if there is none
};

/// Decodes both. Alpha is straight as in PNG: color is not multiplied by it. Throws Error like
/// read_photo().
PhotoWithAlpha read_photo_with_alpha(const std::filesystem::path& path);

/// The size of a photo from its header. Throws Error like read_photo().
PhotoSize read_photo_size(const std::filesystem::path& path);

/// The EXIF orientation in a photo's header, 1 to 8; 1 (upright) if there is none. A build without
/// OpenImageIO reads it of JPEG files. read_photo() does not follow it, but upright() does
/// (orientation.h). Throws Error like read_photo().
int read_photo_orientation(const std::filesystem::path& path);

/// Where a photo was taken, by the GPS tags of EXIF; none if a coordinate or the altitude is
/// missing or not on earth. The height is the altitude as it stands there, negative if the tag says
/// "below"; few cameras say above what it is measured. Throws Error like read_photo(), and in a
/// build without OpenImageIO.
std::optional<Geodetic> read_photo_place(const std::filesystem::path& path);

/// How a photo was exposed, by EXIF: log2(seconds ISO / f-number^2), which is one more where the
/// sensor got twice the light or amplified it twice as much. None if one of the three tags is
/// missing or not above 0; a build without OpenImageIO reads them of JPEG files. Throws Error like
/// read_photo().
std::optional<float> read_exposure_stops(const std::filesystem::path& path);

/// The picture at another size: every target pixel is the mean of the source area that it covers,
/// with pixels that it covers in part counted by that part; halves are rounded up. Exact (whole
/// numbers), so the same on every machine. `width` and `height` are > 0.
Image8 area_resized(const Image8& image, int width, int height);

/// A sentence for photos that dataset.resolution = 0 has reduced. `largest` is the size of the
/// largest photo, and `reduced` its size in training.
std::string note_on_reduced_photos(const PhotoSize& largest, const PhotoSize& reduced);

}  // namespace gs
