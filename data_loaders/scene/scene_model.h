// SPDX-License-Identifier: Apache-2.0
// The cameras, points and files of a scene, whatever program has written them: all that is known
// before the first photo is opened.
#pragma once

#include <filesystem>
#include <string>
#include <vector>

#include "data_loaders/colmap/colmap_model.h"
#include "data_loaders/scene/depth/depth_files.h"
#include "data_loaders/scene/find_scene.h"
#include "data_loaders/scene/scene_files.h"
#include "gs_core/config/config.h"

namespace gs {

struct SceneModel {
  ColmapModel model;                  // images sorted by name
  std::vector<bool> is_test;          // (images)   held out to measure on
  bool is_split_by_files = false;     // transforms.json or Blender's files name the test photos
  std::size_t time_count = 0;         // different times of the photos; 2 and more: it moves
  Vec3d world_offset{0.0, 0.0, 0.0};  // taken off the model's coordinates (world_offset.h)
  MaskSource masks;
  std::vector<std::filesystem::path> photos;      // (images)   the video of an image of a video
  std::vector<std::filesystem::path> mask_files;  // (images)   empty: none
  DepthSource depth;
  std::vector<std::filesystem::path> depth_files;  // (images)   empty: none

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

/// Photos of a model that training cannot use because their files are not there, or not to the end.
/// Indices of model.images.
struct LostPhotos {
  std::vector<std::size_t> missing, cut_short;
  bool are_few = true;  // training goes on without them
};
/// `photos`: their files, empty where there is none.
LostPhotos lost_photos(const ColmapModel& model, const std::vector<std::filesystem::path>& photos);

/// The three steps of read_scene_model(), for callers that report faults instead of stopping.
/// First: reads a COLMAP model or transforms.json and splits it, as the files say or else by
/// test_views_of(). The images' observations are read if dataset.exposure or dataset.refine_cameras
/// asks for them, or `tracks` does. Coordinates are the model's own; files are not looked for.
SceneModel read_model_and_split(const DatasetConfig& dataset, const SceneFolders& folders,
                                Tracks tracks = Tracks::skip);
/// Second: takes the offset off the coordinates of a scene far from the origin.
void move_near_origin(SceneModel& scene);
/// Gives the images times by dataset.times (photo_times.h). With `frames`, each image becomes the
/// frames of its camera.
void find_times(const DatasetConfig& dataset, const SceneFolders& folders, SceneModel& scene);
/// Third: the files of photos, masks and depth maps. A few photos that are missing or cut short are
/// taken out of the model, with a warning (LostPhotos). Throws Error for more of them, and for a
/// name that leads out of the images folder.
void find_scene_files(const DatasetConfig& dataset, const SceneFolders& folders, SceneModel& scene);

/// All that later stages need to know of a scene. Throws Error that names the file and the remedy,
/// also for a model that has next to none of the photos; UsageError if nothing is left to train on.
/// `tracks` as for read_model_and_split().
SceneModel read_scene_model(const DatasetConfig& dataset, const SceneFolders& folders,
                            Tracks tracks = Tracks::skip);

}  // namespace gs
