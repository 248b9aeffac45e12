// SPDX-License-Identifier: Apache-2.0
// From the image names of a model to the files of photos and masks. Photos are often converted or
// renamed after COLMAP has seen them, so a file may have another name than its image.
#pragma once

#include <filesystem>
#include <string>
#include <vector>

#include "data_loaders/colmap/colmap_model.h"
#include "data_loaders/photos/photos.h"
#include "data_loaders/scene/find_scene.h"
#include "gs_core/config/config.h"

namespace gs {

/// The file of each image name, empty if there is none. That is the file of the same name or else
/// the one picture that differs only in upper and lower case, or in its extension, or in both. An
/// ambiguous match is ignored: `a.jpg` gets neither of `a.png` and `a.tif`. The folder is part of
/// the name: `left/1.jpg` and `right/1.jpg` are two photos. Warns with a count of differing names.
std::vector<std::filesystem::path> match_photos(const std::vector<std::string>& names,
                                                const std::filesystem::path& folder);

/// match_photos() for the images of a model. Those of a video get the video.
std::vector<std::filesystem::path> match_photos(const ColmapModel& model,
                                                const std::filesystem::path& folder);

/// Throws Error that lists the images without a file. `paths` is what match_photos() gave.
[[noreturn]] void fail_missing_photos(const ColmapModel& model,
                                      const std::vector<std::filesystem::path>& paths,
                                      const std::filesystem::path& folder);

/// What to do about a photo that is missing: in words, for the end of a message.
std::string remedy_of_missing(const std::string& name, const std::filesystem::path& folder);

/// The pictures in and below a folder that are not in `files`: sorted paths relative to the folder.
/// Each entry of `files` is empty or begins with the folder.
std::vector<std::string> pictures_besides(const std::vector<std::filesystem::path>& files,
                                          const std::filesystem::path& folder);

/// How masks change a photo (dataset.masks, mask_mode and invert_masks).
struct MaskUse {
  bool use_alpha = true;         // the alpha of photos without a mask file
  bool over_background = false;  // masked pixels show the background; else they are ignored
  bool invert = false;           // in mask files, black trains
};

/// Where the mask files of a scene are.
struct MaskSource : MaskUse {
  std::filesystem::path folder;  // empty: there are none
  std::filesystem::path images;  // photos' names are relative to it
  bool is_named = false;         // by dataset.masks; else the folder was only found
};

/// The masks of a scene. Throws Error if dataset.masks is not a folder.
MaskSource find_masks(const DatasetConfig& dataset, const SceneFolders& folders);

/// The mask file of each photo, empty if it has none. `names` are those of the model, `photos` the
/// files. The mask of photo a/b.jpg is the first of these in the masks' folder:
///   a/b.jpg.png   COLMAP's        a/b.jpg       the same name
///   a/b.png       another ending, if no other photo has that name
///   a/b.mask.png, a/b_mask.png
/// For a frame of the video a.mp4, they are followed by a.mp4.png, a mask of all its frames. Any other picture's ending may stand for .png, if there is one such file. Warns with a count if
/// some photos have no mask. Throws Error if a photo could have two masks, and if none of the
/// photos has one in the folder named by dataset.masks.
///
/// `of_model`: mask files named by the model (mask_path in transforms.json), empty paths elsewhere.
/// They go before those of a folder that was only found, and are ignored if dataset.masks is set.
std::vector<std::filesystem::path> match_masks(const MaskSource& source,
                                               const std::vector<std::string>& names,
                                               const std::vector<std::filesystem::path>& photos,
                                               const std::vector<std::filesystem::path>& of_model);

}  // namespace gs
