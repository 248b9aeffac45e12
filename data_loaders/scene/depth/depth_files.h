// SPDX-License-Identifier: Apache-2.0
// From the image names of a model to the files of depth maps.
#pragma once

#include <filesystem>
#include <string>
#include <vector>

#include "data_loaders/scene/find_scene.h"
#include "gs_core/config/config.h"

namespace gs {

/// Where the depth maps of a scene are (dataset.depth).
struct DepthSource {
  std::filesystem::path folder;  // empty: there are none, or only those that the model names
  std::filesystem::path images;  // photos' names are relative to it
  bool is_named = false;         // by dataset.depth; else the folder was only found
  bool is_used = true;           // false: dataset.depth is none
  DepthKind kind = DepthKind::automatic;
  float unit = 1e-3f;  // world units of a step of integers
};

/// The depth maps of a scene. Throws Error if dataset.depth is not a folder.
DepthSource find_depth(const DatasetConfig& dataset, const SceneFolders& folders);

/// The map of each photo, empty if it has none, by the rules of FilesOfPhotos. `names` are those of
/// the model, `photos` the photos' files, `of_model` the maps that the model itself names, which
/// count where no folder is named. Throws Error where dataset.depth names a folder without the map
/// of any photo, and warns of one that was only found.
std::vector<std::filesystem::path> match_depth(const DepthSource& source,
                                               const std::vector<std::string>& names,
                                               const std::vector<std::filesystem::path>& photos,
                                               const std::vector<std::filesystem::path>& of_model);

}  // namespace gs
