// SPDX-License-Identifier: Apache-2.0
// What a reconstruction will do, decided before anything is written: which photos, which COLMAP
// program, which options.
#pragma once

#include <filesystem>
#include <string>
#include <string_view>
#include <vector>

#include "data_loaders/reconstruct/photo_folder.h"
#include "data_loaders/reconstruct/run_colmap.h"

namespace gs {

inline constexpr std::size_t kFewestPhotos = 3;  // of a scene to train on

/// Paths inside the scene's folder.
struct SceneFiles {
  std::filesystem::path root;
  std::filesystem::path work = {};  // a folder in it where images and sparse are made (SceneState)
  std::filesystem::path images() const { return root / "images"; }
  std::filesystem::path sparse() const { return root / "sparse"; }
  std::filesystem::path new_images() const { return work / "images"; }
  std::filesystem::path new_sparse() const { return work / "sparse"; }
  /// Where the photos lie: in new_images() until the scene is finished, unless they were in place.
  std::filesystem::path photos() const {
    return !work.empty() && std::filesystem::exists(new_images()) ? new_images() : images();
  }
  std::filesystem::path attempt() const { return work / "models"; }  // the mapper's
  std::filesystem::path known() const { return work / "known"; }     // poses that are known
  std::filesystem::path views() const { return work / "views"; }     // of panoramas
  std::filesystem::path rig() const { return work / "rig.json"; }    // of these views
  std::filesystem::path vocabulary() const { return work / "vocabulary.bin"; }
  std::filesystem::path global_database() const { return work / "global.db"; }
  std::filesystem::path photo_list() const { return work / "photos.txt"; }
  std::filesystem::path database() const { return root / "database.db"; }
  std::filesystem::path log() const { return root / "colmap.log"; }
  std::filesystem::path state() const { return root / "reconstruct.json"; }
};

struct ColmapPlan {
  SceneFiles files;
  std::vector<std::filesystem::path> videos;  // where there are some, the photos are their frames
  std::vector<PhotoFile> photos;              // of videos: empty until the frames are there
  bool photos_in_place = false;               // the photos are in the scene's images/ already
  std::string program, camera_model;
  Matching matching = Matching::automatic;
  Mapper mapper = Mapper::automatic;
  bool single_camera = false;  // one lens took all photos: see camera_groups()
  bool use_gpu = false;        // until COLMAP turns out to have no CUDA, or to fail with it
  int max_features = 0, frames = 0, threads = 0;
  SingleCamera single_camera_setting = SingleCamera::automatic;
  bool has_short_flags = false;                        // as in ColmapJob
  std::shared_ptr<const ColmapModel> poses = nullptr;  // as in ColmapJob

  /// Whether the photos are panoramas of 360 degrees, which COLMAP sees as panorama_views().
  bool has_panoramas() const { return !photos.empty() && photos[0].is_panorama; }
  /// How to set a setting on the command line, for advice: "--matching exhaustive", or "--set
  /// reconstruct.matching=exhaustive" in verbs without that flag.
  std::string flag(std::string_view key, std::string_view value) const;
};

/// Decides everything that can be decided before the frames of videos are there. Throws Error and
/// UsageError as run_colmap() does.
ColmapPlan plan_of(const ColmapJob& job);

/// Decides the rest once `plan.photos` are known. `source` is for messages.
void complete_plan(ColmapPlan& plan, const std::filesystem::path& source);

/// The photos that share a camera of the model, where there is one lens: a camera has one size, so
/// photos that were held upright and on the side have one each. Else all photos are one group.
std::vector<std::vector<PhotoFile>> camera_groups(const ColmapPlan& plan);

/// A text of the photos and settings that a result depends on: the same text, the same result.
std::string made_of(const ColmapPlan& plan);

}  // namespace gs
