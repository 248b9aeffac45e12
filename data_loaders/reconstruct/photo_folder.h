// SPDX-License-Identifier: Apache-2.0
// A folder that holds photos or videos and no model: what `gemsplat reconstruct` begins with.
#pragma once

#include <filesystem>
#include <string>
#include <vector>

#include "data_loaders/photos/photos.h"

namespace gs {

struct PhotoFile {
  std::filesystem::path path;
  std::string name;  // relative to the folder, "/" between folders
  PhotoSize size;
};

/// The photos in and below a folder, or below its images/ where it has none itself; sorted by name, hidden
/// files, scenes and runs of ours, `masks/` and all below `without` left out. A photo that cannot be read is left out with a warning.
/// Throws Error where there is none, and says what there is instead.
std::vector<PhotoFile> find_photos(const std::filesystem::path& folder,
                                   const std::filesystem::path& without);

/// The video that `source` is, or those that the folder holds if it holds no photos; sorted.
std::vector<std::filesystem::path> find_videos(const std::filesystem::path& source);

/// Whether this is a video, or there are photos in the folder or its images/, or videos in it, and nothing that says where they were taken:
/// no COLMAP model in it, one level up or down or in a sparse/N, and no transforms*.json.
bool holds_only_photos(const std::filesystem::path& folder);

}  // namespace gs
