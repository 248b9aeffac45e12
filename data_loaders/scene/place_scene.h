// SPDX-License-Identifier: Apache-2.0
// Where the photos of a scene are: the file of each. Photos are often converted or renamed after
// COLMAP has seen them, so a file may have another name than its image.
#pragma once

#include <filesystem>
#include <string>
#include <vector>

#include "data_loaders/scene/scene_model.h"

namespace gs {

/// The file of each image name, empty if there is none. That is the file of the same name or else
/// the one picture that differs only in upper and lower case, or in its extension, or in both. An
/// ambiguous match is ignored: `a.jpg` gets neither of `a.png` and `a.tif`. The folder is part of
/// the name: `left/1.jpg` and `right/1.jpg` are two photos. Warns with a count of differing names.
std::vector<std::filesystem::path> match_photos(const std::vector<std::string>& names,
                                                const std::filesystem::path& folder);

/// match_photos() for the photos of a scene that are no frames of videos.
void match_photos(SceneModel& scene);

/// What to do about a photo that is missing: in words, for the end of a message.
std::string remedy_of_missing(const std::string& name, const std::filesystem::path& folder);

/// The pictures in and below the photos' folder that no photo of the scene is: sorted paths relative
/// to the folder.
std::vector<std::string> pictures_besides(const SceneModel& scene);

/// Photos that training cannot use because their files are not there, or not to the end. Indices of
/// photos.
struct LostPhotos {
  std::vector<std::size_t> missing, cut_short;
  bool are_few = true;  // training goes on without them
};
LostPhotos lost_photos(const SceneModel& scene);

/// The files of photos, masks and depth maps; panoramas are split afterwards. A few photos that are
/// missing or cut short are taken out of the scene, with a warning (LostPhotos). Throws Error for
/// more of them, and for a name that leads out of the images folder.
void find_scene_files(const DatasetConfig& dataset, SceneModel& scene);

/// Moves the scene near the origin, gives its photos times by dataset.times and finds their files.
/// Throws Error that names the file and the remedy, also for a model that has next to none of the
/// photos; UsageError if nothing is left to train on.
void place_scene(const DatasetConfig& dataset, SceneModel& scene);

}  // namespace gs
