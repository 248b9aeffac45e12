// SPDX-License-Identifier: Apache-2.0
// The cameras of a scene, whatever program has found them.
#pragma once

#include "data_loaders/colmap/colmap_model.h"
#include "data_loaders/scene/find_scene.h"
#include "gs_core/config/config.h"

namespace gs {

struct SceneModel {
  ColmapModel model;          // images sorted by name
  std::vector<bool> is_test;  // of each image: held out to measure on
  Vec3d world_offset{0.0, 0.0, 0.0};  // taken off the model's coordinates (world_offset.h)
};

/// Reads a COLMAP model or transforms.json, and splits it: as transforms.json or a Blender scene says, or else by
/// test_views_of(); without dataset.eval nothing is held out. Throws Error like the readers; UsageError where nothing is left
/// to train on.
/// The images' observations are read where dataset.exposure or dataset.refine_cameras asks for
/// them.
SceneModel read_scene_model(const DatasetConfig& dataset, const SceneFolders& folders);

}  // namespace gs
