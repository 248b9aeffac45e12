// SPDX-License-Identifier: Apache-2.0
// The state that the parts of an examination share; used by doctor/*.cpp only. Each part adds its
// findings, and later parts use the files and sizes that earlier ones found.
#pragma once

#include <filesystem>
#include <string>
#include <vector>

#include "data_loaders/counted.h"
#include "data_loaders/doctor/doctor.h"
#include "data_loaders/photos/photos.h"
#include "data_loaders/photos/picture_quality.h"
#include "data_loaders/scene/companions.h"
#include "data_loaders/scene/split_panoramas.h"

namespace gs {

inline constexpr std::size_t kFewPhotos = 20;  // fewer seldom show a scene from all sides

struct Examination {
  using Level = Finding::Level;

  const Config& config;
  const ProgressFn& progress;
  Diagnosis diagnosis = {};

  SceneModel scene = {};                 // sizes of photos are 0 x 0 if unknown
  std::vector<std::size_t> usable = {};  // photos that can be trained on
  double masked_share = 0;               // of the photos

  const ColmapModel& model() const { return scene.model; }
  /// Before resizing.
  PhotoSize picture_size_of(std::size_t photo) const {
    return picture_size(scene.photos[photo].size,
                        model().cameras.at(model().images[photo].camera_id));
  }
  void add(Level level, std::string topic, std::string text, std::vector<std::string> names = {}) {
    diagnosis.findings.push_back({level, std::move(topic), std::move(text), std::move(names)});
  }
  std::vector<std::string> names_of(const std::vector<std::size_t>& photos) const {
    std::vector<std::string> names;
    for (const std::size_t i : photos) names.push_back(scene.photos[i].name);
    return names;
  }
};

// examine_bare_photos.cpp: returns false, and does nothing, where there is a model or no photo.
bool examine_bare_photos(Examination& examination, bool look_at_pictures);

// examine_model.cpp, in this order. The first two return false if the rest makes no sense.
bool find_folders(Examination& examination);
bool read_model(Examination& examination);
void examine_lenses(Examination& examination);
void examine_cameras(Examination& examination);
void examine_points(Examination& examination);
void examine_sight(Examination& examination);

// examine_photos.cpp, in this order.
void match_photo_files(Examination& examination);
void match_mask_files(Examination& examination);
void examine_headers(Examination& examination);
/// Says that large photos are reduced. `largest` is the size of the largest one.
void report_reduced_photos(Examination& examination, const PhotoSize& largest);
void examine_pictures(Examination& examination);
/// Names photos that are much less sharp, darker or brighter than the others.
void report_quality(Examination& examination, const std::vector<std::string>& names,
                    const std::vector<PictureQuality>& qualities);

/// Finds the files of a kind, and reports how many photos have one. `without` says what is
/// done with the others. False if none has.
bool match_files_of(const CompanionKind& kind, Examination::Level of_missing, const char* without,
                    Examination& examination);

// examine_maps.cpp: after the headers. With `look_at_maps` they read each map.
void examine_depth(Examination& examination, bool look_at_maps);
void examine_normals(Examination& examination, bool look_at_maps);

// examine_light.cpp: after all others, because it decodes all photos once more.
void examine_light(Examination& examination);

}  // namespace gs
