// SPDX-License-Identifier: Apache-2.0
#include "data_loaders/scene/scene_model.h"

#include <spdlog/fmt/fmt.h>

#include <algorithm>
#include <set>

#include "data_loaders/colmap/world_offset.h"
#include "data_loaders/scene/split.h"
#include "data_loaders/scene/transforms_json.h"
#include "gs_core/error.h"

namespace gs {

namespace {

SceneModel read_model_and_split(const DatasetConfig& dataset, const SceneFolders& folders) {
  const auto by_name = [](const ColmapImage& a, const ColmapImage& b) { return a.name < b.name; };
  SceneModel scene;
  if (is_colmap_model(folders.model)) {
    scene.model = read_colmap_model(
        folders.model, dataset.exposure || dataset.refine_cameras ? Tracks::read : Tracks::skip);
    std::sort(scene.model.images.begin(), scene.model.images.end(), by_name);
    scene.is_test = test_views_of(dataset, scene.model);
    return scene;
  }
  TransformsScene transforms = read_transforms(folders.model);
  scene.model = std::move(transforms.model);
  std::sort(scene.model.images.begin(), scene.model.images.end(), by_name);
  if (!transforms.has_split || !dataset.eval) {
    scene.is_test = test_views_of(dataset, scene.model);
    return scene;
  }
  const std::set<std::string> held_out(transforms.test_names.begin(), transforms.test_names.end());
  for (const ColmapImage& image : scene.model.images)
    scene.is_test.push_back(held_out.contains(image.name));
  if (std::find(scene.is_test.begin(), scene.is_test.end(), false) == scene.is_test.end())
    throw UsageError(fmt::format(
        "no view is left to train on: the files in {} put all of them to testing; train without "
        "dataset.eval",
        folders.model.string()));
  return scene;
}

}  // namespace

SceneModel read_scene_model(const DatasetConfig& dataset, const SceneFolders& folders) {
  SceneModel scene = read_model_and_split(dataset, folders);
  scene.world_offset = world_offset_of(scene.model);
  if (scene.world_offset != Vec3d(0.0)) take_off(scene.model, scene.world_offset);
  return scene;
}

}  // namespace gs
