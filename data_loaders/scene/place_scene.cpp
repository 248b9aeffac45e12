// SPDX-License-Identifier: Apache-2.0
#include "data_loaders/scene/place_scene.h"

#include <spdlog/fmt/fmt.h>

#include <algorithm>
#include <set>
#include <unordered_map>
#include <unordered_set>

#include "data_loaders/counted.h"
#include "data_loaders/photos/cut_short.h"
#include "data_loaders/photos/photo_names.h"
#include "data_loaders/scene/companions.h"
#include "data_loaders/scene/photo_times.h"
#include "data_loaders/scene/split_panoramas.h"
#include "gs_core/error.h"
#include "gs_core/system/log.h"
#include "gs_core/system/text/ascii.h"
#include "gs_core/threads/parallel.h"

namespace gs {
namespace {

namespace fs = std::filesystem;

constexpr double kMostLost = 0.2;  // of the photos: more missing are another folder, or no scene

std::string lower_without_extension(const std::string& name) {
  return lowercase(without_extension(name));
}

/// Names with the same key may be the same photo. The closest likeness comes first.
struct Likeness {
  std::string (*key)(const std::string& name);
  const char* difference;
};
constexpr Likeness kLikenesses[] = {
    {[](const std::string& name) { return lowercase(name); }, "upper and lower case"},
    {without_extension, "extension"},
    {lower_without_extension, "case and extension"}};

/// The names of each key. Names that share one are ambiguous.
std::unordered_map<std::string, std::vector<std::string>> by_key(const std::set<std::string>& names,
                                                                 const Likeness& likeness) {
  std::unordered_map<std::string, std::vector<std::string>> result;
  for (const std::string& name : names) result[likeness.key(name)].push_back(name);
  return result;
}

/// Finds pairs of a missing name and a file with the same key, where no other name or file has that
/// key. Returns the file of each such name and takes the pairs out of both sets.
std::unordered_map<std::string, std::string> pair_off(std::set<std::string>& missing,
                                                      std::set<std::string>& files,
                                                      const Likeness& likeness) {
  const auto files_by_key = by_key(files, likeness);
  std::unordered_map<std::string, std::string> pairs;
  for (const auto& [key, names] : by_key(missing, likeness)) {
    const auto alike = files_by_key.find(key);
    if (names.size() != 1 || alike == files_by_key.end() || alike->second.size() != 1) continue;
    pairs[names[0]] = alike->second[0];
    missing.erase(names[0]);
    files.erase(alike->second[0]);
  }
  if (!pairs.empty()) {
    const auto first = std::min_element(pairs.begin(), pairs.end());
    log_warning("{} for names in the model that differ in {}: {} for '{}'{}",
                counted(pairs.size(), "photo", "is taken", "are taken"), likeness.difference,
                first->second, first->first, pairs.size() > 1 ? ", ..." : "");
  }
  return pairs;
}

[[noreturn]] void fail_missing(const SceneModel& scene) {
  constexpr std::size_t kMostNamed = 10;
  std::vector<std::string> missing;
  for (const Photo& photo : scene.photos)
    if (photo.file.empty()) missing.push_back(photo.name);
  std::string list;
  for (std::size_t i = 0; i < std::min(missing.size(), kMostNamed); ++i)
    list += (i ? ", " : "") + missing[i];
  if (missing.size() > kMostNamed) list += fmt::format(" and {} more", missing.size() - kMostNamed);
  const std::vector<std::string> unused = pictures_besides(scene);
  const std::string others =
      unused.empty() ? ""
                     : fmt::format(" ({} not in the model or match several names: {}{})",
                                   counted(unused.size(), "photo", "there is", "there are"),
                                   unused.front(), unused.size() > 1 ? ", ..." : "");
  const fs::path& folder = scene.folders.images;
  throw Error(fmt::format("{} of the model's {} photos {} not in {}: {}{}; {}", missing.size(),
                          scene.photos.size(), missing.size() == 1 ? "is" : "are", folder.string(),
                          list, others, remedy_of_missing(missing[0], folder)));
}

/// Image names lead to files below the images folder, here and wherever a run writes pictures by
/// view name.
void check_name(const std::string& text, const fs::path& model) {
  const fs::path name = text;
  if (name.is_absolute() || std::find(name.begin(), name.end(), "..") != name.end())
    throw Error(
        fmt::format("cannot use the model in {}: image name '{}' leads out of the images folder; "
                    "rename it in the model",
                    model.string(), text));
}

/// A few photos that were deleted or cut short cost themselves, and not the run. The split of the
/// others stays.
void leave_out_lost(SceneModel& scene) {
  const LostPhotos lost = lost_photos(scene);
  if (!lost.are_few) {
    if (!lost.missing.empty()) fail_missing(scene);
    return;  // the reader of the first one says what it is
  }
  std::vector<bool> is_there(scene.photos.size(), true);
  std::string names;
  for (const auto* some : {&lost.missing, &lost.cut_short})
    for (const std::size_t i : *some) {
      is_there[i] = false;
      names += (names.empty() ? "" : ", ") + scene.photos[i].name +
               (some == &lost.missing ? " (missing)" : " (cut short)");
    }
  if (names.empty()) return;
  log_warning("{} of {} left out, because the files in {} are missing or cut short: {}",
              lost.missing.size() + lost.cut_short.size(),
              counted(scene.photos.size(), "photo", "is", "are"), scene.folders.images.string(),
              names);
  keep(is_there, scene.model.images);
  keep(is_there, scene.photos);
  if (std::ranges::all_of(scene.photos, &Photo::is_test))
    throw Error(
        fmt::format("no view is left to train on: all training photos of {} are missing or "
                    "cut short; copy them again",
                    scene.model.folder.string()));
}

/// Refuses a model with next to none of the photos: COLMAP gave up, or began another model.
void check_registered(const SceneModel& scene) {
  constexpr std::size_t kFewRegistered = 3;  // fewer are suspicious
  constexpr std::size_t kManyTimes = 3;      // as many photos or more are "many more"
  const std::size_t registered = scene.photos.size();
  if (registered >= kFewRegistered) return;
  const fs::path& images = scene.folders.images;
  const std::size_t photos = picture_names_in(images).size();
  if (photos < kManyTimes * registered) return;
  const bool is_of_colmap = scene.folders.kind == SceneKind::colmap;
  throw Error(fmt::format(
      "the model in {} holds only {} of the {} photos in {}: {} could not register the others; {}",
      scene.model.folder.string(), registered, photos, images.string(),
      is_of_colmap ? "COLMAP" : "its program",
      is_of_colmap ? "run COLMAP again (exhaustive matching, or photos that overlap more), or use "
                     "this model "
                     "nevertheless by naming it with --set dataset.model=FOLDER"
                   : "let COLMAP place all photos with `gemsplat reconstruct`, or use this model "
                     "nevertheless "
                     "by naming it with --set dataset.model=FILE"));
}

}  // namespace

std::vector<fs::path> match_photos(const std::vector<std::string>& names, const fs::path& folder) {
  std::set<std::string> missing;
  for (const std::string& name : names) {
    std::error_code ignored;
    if (!fs::exists(folder / name, ignored)) missing.insert(name);
  }
  std::unordered_map<std::string, std::string> file_of;
  if (!missing.empty()) {
    const std::unordered_set<std::string> wanted(names.begin(), names.end());
    std::set<std::string> files;
    for (std::string& file : picture_names_in(folder))
      if (!wanted.contains(file)) files.insert(std::move(file));
    for (const Likeness& likeness : kLikenesses) file_of.merge(pair_off(missing, files, likeness));
  }
  std::vector<fs::path> paths;
  for (const std::string& name : names) {
    const auto found = file_of.find(name);
    if (missing.contains(name))
      paths.emplace_back();
    else
      paths.push_back(folder / (found == file_of.end() ? name : found->second));
  }
  return paths;
}

std::vector<std::string> pictures_besides(const SceneModel& scene) {
  const fs::path& folder = scene.folders.images;
  std::unordered_set<std::string> taken;
  for (const Photo& photo : scene.photos)
    taken.insert(photo.file.lexically_relative(folder).generic_string());
  std::vector<std::string> names = picture_names_in(folder);
  std::erase_if(names, [&](const std::string& name) { return taken.contains(name); });
  return names;
}

std::string remedy_of_missing(const std::string& name, const fs::path& folder) {
  const fs::path video = video_of_camera(folder, without_extension(name));
  if (video.empty())
    return "copy them there or name another folder with --set dataset.images=FOLDER";
  return fmt::format(
      "there is the video {}: if cameras stand still and film, add --set "
      "dataset.times=frames",
      video.filename().string());
}

void match_photos(SceneModel& scene) {
  std::vector<std::string> names;
  for (const Photo& photo : scene.photos)
    if (!photo.is_frame) names.push_back(photo.name);
  std::vector<fs::path> files = match_photos(names, scene.folders.images);
  auto next = files.begin();
  for (Photo& photo : scene.photos)
    if (!photo.is_frame) photo.file = std::move(*next++);
}

LostPhotos lost_photos(const SceneModel& scene) {
  LostPhotos lost;
  const std::vector<Photo>& photos = scene.photos;
  std::vector<char> is_cut(photos.size(), false);
  parallel_for(photos.size(), 1, [&](std::size_t i) {
    if (!photos[i].file.empty() && !photos[i].is_frame) is_cut[i] = is_cut_short(photos[i].file);
  });
  for (std::size_t i = 0; i < photos.size(); ++i) {
    if (photos[i].file.empty()) lost.missing.push_back(i);
    if (is_cut[i]) lost.cut_short.push_back(i);
  }
  lost.are_few =
      double(lost.missing.size() + lost.cut_short.size()) <= kMostLost * double(photos.size());
  return lost;
}

void find_scene_files(const DatasetConfig& dataset, SceneModel& scene) {
  for (const Photo& photo : scene.photos) check_name(photo.name, scene.model.folder);
  match_photos(scene);
  leave_out_lost(scene);
  match_companions(kMasks, dataset, scene);
  match_companions(kDepthMaps, dataset, scene);
  if (const std::size_t panoramas = split_panoramas(scene))
    log_info("{}", text_of_panoramas(panoramas));
}

void place_scene(const DatasetConfig& dataset, SceneModel& scene) {
  move_near_origin(scene);
  if (dataset.model.empty() && dataset.times != PhotoTimes::frames) check_registered(scene);
  find_times(dataset, scene);
  find_scene_files(dataset, scene);
}

}  // namespace gs
