// SPDX-License-Identifier: Apache-2.0
// Small pictures of photos, made once and kept in the project's .thumbs/.
#pragma once

#include <filesystem>
#include <string>

#include "gs_app/studio/project.h"

namespace gs {

inline constexpr int kThumbnailSide = 320;  // pixels, at most, of the longer side

struct ThumbnailShape {
  int degrees = 0;  // the photo is turned, as is_turn() says
  int longer_side = kThumbnailSide;
};

/// The file of a photo's small picture, upright and turned, a JPEG. Throws Error where there is no such
/// photo or it cannot be read. One is made at a time.
std::filesystem::path thumbnail_of(const Project& project, const std::string& name,
                                   const ThumbnailShape& shape = {});

}  // namespace gs
