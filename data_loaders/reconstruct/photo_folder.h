// SPDX-License-Identifier: Apache-2.0
// Folders of photos or videos without a model: the input of `gemsplat reconstruct`.
#pragma once

#include <filesystem>
#include <string>
#include <vector>

#include "data_loaders/photos/photos.h"

namespace gs {

struct PhotoFile {
  std::filesystem::path path;
  std::string name;          // in the scene: relative to the folder, "/" between folders
  PhotoSize size;            // in the scene
  bool is_copied = false;    // the scene gets an upright copy (write_copy()), not the file
  int orientation = 1;       // of the file, by EXIF
  bool is_panorama = false;  // of 360 degrees
};

/// Whether the photos are brought into a scene, or lie in its images/ and stay as they are.
enum class PhotoUse { brought, in_place };

/// The photos in a folder and below it, or in its images/ where it has none itself; sorted by name.
/// Hidden files, scenes and runs of gemsplat, `masks/`, `depth/` and everything below `without` are
/// left out. So are photos that cannot be read or are cut short, and panoramas of 360 degrees among
/// ordinary photos, with a warning that names them. Photos that EXIF
/// turns, or of formats that COLMAP does not read, get copies in the scene: a.heic becomes a.jpg,
/// and a.webp a.png. In place there are no copies, and a warning names these photos. Throws Error
/// where there is no photo, and says what there is instead. Warnings name videos, archives, photos of
/// unknown formats and copies of a photo.
std::vector<PhotoFile> find_photos(const std::filesystem::path& folder,
                                   const std::filesystem::path& without,
                                   PhotoUse use = PhotoUse::brought);

/// The video `source`, or the videos in the folder `source` if there are no photos in and below it;
/// sorted.
std::vector<std::filesystem::path> find_videos(const std::filesystem::path& source);

/// Whether this is a video, or a folder of photos, in it or below, or of videos, without camera
/// poses: there is no COLMAP model in it, one level up or anywhere below, and no transforms*.json.
bool holds_only_photos(const std::filesystem::path& folder);

}  // namespace gs
