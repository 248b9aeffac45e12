// SPDX-License-Identifier: Apache-2.0
// Panoramas of 360 degrees: what tells them from other pictures.
#pragma once

#include <filesystem>

#include "data_loaders/photos/photos.h"

namespace gs {

/// Whether a photo maps the whole sphere (equirectangular): its XMP says so (GPano), or it is
/// exactly twice as wide as high, 3,000 pixels or wider, and EXIF knows no focal length. `size` is
/// that of the photo.
bool is_panorama(const std::filesystem::path& photo, const PhotoSize& size);

/// The XMP of such a picture (Google's Photo Sphere), by which viewers know it.
std::string panorama_xmp(int width, int height);

}  // namespace gs
