// SPDX-License-Identifier: Apache-2.0
// The files that other programs make for photos, one for each: masks, depth maps and normal maps.
#pragma once

#include "data_loaders/scene/scene_model.h"

namespace gs {

/// A kind of such files, and its words in messages.
struct CompanionKind {
  const char *suffix, *noun;         // of file names, and in messages
  const char *folder, *flag, *none;  // where they are found, and how to say where
  std::string DatasetConfig::*setting;
  std::filesystem::path ColmapImage::*of_model;  // null: models name none
  std::filesystem::path Photo::*file;
  Companions SceneModel::*source;
  // The names that the file of a photo could have; {0} is the photo, {1} its name without ending.
  const char* names;
  // Says that there are photos without a file, {0} of them; null: that is nothing special.
  const char* partial;
};
extern const CompanionKind kMasks, kDepthMaps, kNormalMaps;

/// Where dataset.masks, dataset.depth or dataset.normals says that they are. Throws Error if that is no folder.
Companions find_companions(const CompanionKind& kind, const DatasetConfig& dataset);

/// find_companions(), and the file of each photo, empty if it has none. For a photo a/b.jpg and the
/// kind "mask" that is the first of these in the folder:
///   a/b.jpg.png   COLMAP's        a/b.jpg       the same name
///   a/b.png       another ending, if no other photo has that name
///   a/b.mask.png, a/b.jpg.mask.png, a/b_mask.png, a/b.jpg_mask.png
/// For a frame of the video a.mp4, they are followed by a.mp4.png, for all of its frames. Any other
/// picture's ending may stand for .png, if there is one such file.
///
/// A file that the model names (ColmapImage::mask, ColmapImage::depth) goes before those of a folder
/// that was only found, and is ignored if the setting names a folder. Counts the photos without a
/// mask, if some have one, and warns if masks_may_be_lost(). Throws Error if a photo could have two
/// files, and if none of the photos has one in the folder that the setting names.
void match_companions(const CompanionKind& kind, const DatasetConfig& dataset, SceneModel& scene);

/// Where most photos have no mask, it was made for the few that need one.
inline bool masks_may_be_lost(std::size_t missing, std::size_t photos) {
  return 2 * missing <= photos;
}

}  // namespace gs
