// SPDX-License-Identifier: Apache-2.0
// A scene on its way from a folder to its views, whatever program has written it. The stages that
// fill it in are those of load_scene.h.
#pragma once

#include <optional>
#include <string>
#include <vector>

#include "data_loaders/colmap/colmap_model.h"
#include "data_loaders/scene/find_scene.h"
#include "data_loaders/scene/photo.h"
#include "gs_core/config/config.h"
#include "gs_core/scene.h"

namespace gs {

/// Where the masks, the depth maps or the normal maps of a scene are.
struct Companions {
  std::filesystem::path folder;  // empty: there are none, or only those that the model names
  bool is_named = false;         // by the setting; else the folder was only found
  bool is_used = true;           // false: the setting is none

  std::string place() const {
    return folder.empty() ? "the files that the model names" : folder.string();
  }
};

struct SceneModel {
  SceneFolders folders;
  ColmapModel model;                  // images sorted by name
  std::vector<Photo> photos;          // (images)
  bool is_split_by_files = false;     // transforms.json or Blender's files name the test photos
  std::size_t time_count = 0;         // different times of the photos; 2 and more: it moves
  Vec3d world_offset{0.0, 0.0, 0.0};  // taken off the model's coordinates (world_offset.h)
  Companions masks, depth, normals;
  std::vector<ScenePoint> points;  // of the model, in single precision; after plan_scene()
  std::optional<CameraRefinement> refinement;

  bool moves() const { return time_count > 1; }
};

/// Whether each image of the model is a test view, in the order of model.images, which are sorted
/// by name. With dataset.eval, those of dataset.test_names are held out, or else every
/// test_every-th frame, beginning with the first. The photos that a rig took at one moment are one
/// frame and stay together, because they show nearly the same. Every other photo is a frame of its
/// own. Frames are counted in the order of their first names. Throws Error for a model without
/// images; UsageError if nothing is left to train on, and for a name that no image has.
std::vector<bool> test_views_of(const DatasetConfig& dataset, const ColmapModel& model);

/// The number of each image's frame, from 0. The photos that a rig took at one moment are one
/// frame; every other photo is a frame of its own. Frames are numbered in the order of their first
/// images.
std::vector<std::size_t> frame_numbers(const ColmapModel& model);

/// What a model with cameras and without points costs, and how COLMAP finds points for its cameras.
std::string text_of_no_points(int random_points);

/// Reads a COLMAP model or transforms.json and splits it, as the files say or else by
/// test_views_of(). Coordinates are the model's own; files are not looked for. Throws Error that
/// names the file and the remedy; UsageError if nothing is left to train on.
SceneModel read_scene(const DatasetConfig& dataset, const SceneFolders& folders,
                      Tracks tracks = Tracks::skip);

/// Takes the offset off the coordinates of a scene far from the origin.
void move_near_origin(SceneModel& scene);

/// Takes out the elements of a list that are not kept.
template <class T>
void keep(const std::vector<bool>& is_kept, std::vector<T>& list) {
  std::size_t i = 0;
  std::erase_if(list, [&](const T&) { return !is_kept[i++]; });
}

}  // namespace gs
