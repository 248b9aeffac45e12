// SPDX-License-Identifier: Apache-2.0
// Three tags of EXIF in a JPEG file, for builds without OpenImageIO.
#pragma once

#include <cstdint>

#include "data_loaders/photos/photo_codec.h"
#include "gs_core/buffer.h"

namespace gs {

/// The tags in the head of a JPEG file. All are 0 where the file is none, has no EXIF, or is
/// damaged before them.
ExposureTags exposure_tags_of_jpeg(Span<const std::uint8_t> head);

}  // namespace gs
