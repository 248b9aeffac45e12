// SPDX-License-Identifier: Apache-2.0
// Panoramas of 360 degrees among bare photos, which COLMAP's usual lenses cannot place.
#pragma once

#include <filesystem>

#include "data_loaders/photos/photos.h"

namespace gs {

/// Whether a photo maps the whole sphere (equirectangular): its XMP says so (GPano), or it is
/// exactly twice as wide as high, 3,000 pixels or wider, and EXIF knows no focal length. `size` is
/// that of the photo.
bool is_panorama(const std::filesystem::path& photo, const PhotoSize& size);

}  // namespace gs
