// SPDX-License-Identifier: Apache-2.0
// Where a scene's model and photos are.
#pragma once

#include <filesystem>

#include "gs_core/config/config.h"

namespace gs {

/// The program that wrote the cameras.
enum class SceneKind {
  colmap,      // a COLMAP model
  transforms,  // transforms.json of nerfstudio, instant-ngp and others
  blender,     // transforms_train.json and its companions
  foreign,     // a file of Metashape, RealityScan, OpenSfM or another program of foreign_scene.h
};

struct SceneFolders {
  std::filesystem::path model;   // holds cameras.bin or cameras.txt, or transforms*.json; or a file
  std::filesystem::path images;  // the model's image names are relative to it
  SceneKind kind = SceneKind::colmap;
};

/// Finds the model in dataset.model, or else in sparse/0, sparse, colmap/sparse/0 or the scene's
/// folder itself, and the photos in dataset.images. If COLMAP has left several models (sparse/0,
/// sparse/1, ...) the one with the most photos is taken, and the log says so. If it has left none,
/// transforms.json or the three files of a Blender scene are taken, with the photos that they name,
/// or else a file of find_foreign_scene() (or dataset.model itself).
/// Throws Error that lists the searched places and names a scene one level up or down, if any.
SceneFolders find_scene(const DatasetConfig& dataset);

/// The COLMAP model that find_scene() would take without dataset.model; empty if there is none.
std::filesystem::path find_colmap_model(const std::filesystem::path& scene);

/// A scene one level above or below a folder, or in its dense/0; empty if there is none.
std::filesystem::path nearby_scene(const std::filesystem::path& folder);

}  // namespace gs
