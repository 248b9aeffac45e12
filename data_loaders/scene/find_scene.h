// SPDX-License-Identifier: Apache-2.0
// Where a scene's COLMAP model and photos lie.
#pragma once

#include <filesystem>

#include "gs_core/config/config.h"

namespace gs {

struct SceneFolders {
  std::filesystem::path model;   // holds cameras.bin or cameras.txt, or transforms.json
  std::filesystem::path images;  // what the model's image names are relative to
};

/// Finds the model in dataset.model, or else in sparse/0, sparse, colmap/sparse/0 or the scene's folder
/// itself, and the photos in dataset.images. Where COLMAP has left several models (sparse/0,
/// sparse/1, ...) the one with the most photos is taken, and the log says so. Where COLMAP has left none, a
/// transforms.json, or the three files of a Blender scene, is taken with the photos that it names. Throws Error that lists
/// the places looked at and, where there is one, names a scene one level up or down.
SceneFolders find_scene(const DatasetConfig& dataset);

/// The COLMAP model of a folder that find_scene() would take, where none is named; empty where there is none.
std::filesystem::path find_colmap_model(const std::filesystem::path& scene);

}  // namespace gs
