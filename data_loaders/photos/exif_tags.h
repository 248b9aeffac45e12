// SPDX-License-Identifier: Apache-2.0
// Tags of EXIF in a JPEG file, for builds without OpenImageIO.
#pragma once

#include <cstdint>
#include <vector>

#include "data_loaders/photos/photo_codec.h"
#include "gs_core/buffer.h"

namespace gs {

/// The tags in the head of a JPEG file. All are 0 where the file is none, has no EXIF, or is
/// damaged before them.
ExposureTags exposure_tags_of_jpeg(Span<const std::uint8_t> head);

/// The orientation in the head of a JPEG file, as it stands there; 1 where it says nothing.
int orientation_of_jpeg(Span<const std::uint8_t> head);

/// Whether the head of a JPEG file says which focal length took it.
bool has_focal_length_of_jpeg(Span<const std::uint8_t> head);

/// The EXIF segment in the head of a JPEG file, its marker included, for a copy of the photo whose
/// pixels were turned: its orientation is 1. Empty where the file has none.
std::vector<std::uint8_t> upright_exif_of_jpeg(Span<const std::uint8_t> head);

}  // namespace gs
