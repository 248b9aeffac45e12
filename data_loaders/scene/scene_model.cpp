// SPDX-License-Identifier: Apache-2.0
#include "data_loaders/scene/scene_model.h"

#include <spdlog/fmt/fmt.h>

#include <algorithm>
#include <set>
#include <sstream>
#include <unordered_map>

#include "data_loaders/colmap/world_offset.h"
#include "data_loaders/counted.h"
#include "data_loaders/photos/cut_short.h"
#include "data_loaders/photos/photo_names.h"
#include "data_loaders/scene/photo_times.h"
#include "data_loaders/transforms/transforms_json.h"
#include "gs_core/error.h"
#include "gs_core/system/log.h"
#include "gs_core/system/text/ascii.h"
#include "gs_core/threads/parallel.h"

namespace gs {
namespace {

namespace fs = std::filesystem;

constexpr double kMostLost = 0.2;  // of the photos: more missing are another folder, or no scene

// --- Split

/// The split of a scene whose files name the test photos.
std::vector<bool> split_of_files(const TransformsScene& transforms, const ColmapModel& model) {
  const std::set<std::string> held_out(transforms.test_names.begin(), transforms.test_names.end());
  std::vector<bool> is_test;
  for (const ColmapImage& image : model.images) is_test.push_back(held_out.contains(image.name));
  if (std::find(is_test.begin(), is_test.end(), false) == is_test.end())
    throw UsageError(
        fmt::format("no view is left to train on: the files in {} name all of them for testing; "
                    "train without dataset.eval",
                    model.folder.string()));
  return is_test;
}

/// Whether `name` of dataset.test_names means the image: its name, its name without the ending, or a
/// folder that it lies in.
bool is_meant(const std::string& name, const std::string& image) {
  return image == name || without_extension(image) == name || image.starts_with(name + "/");
}

std::vector<std::string> separated(const std::string& names) {
  std::vector<std::string> result;
  std::istringstream stream(names);
  for (std::string name; std::getline(stream, name, ',');) {
    if (const auto word = trimmed(name, " "); !word.empty()) result.emplace_back(word);
  }
  return result;
}

/// The split by dataset.test_names.
std::vector<bool> split_by_names(const DatasetConfig& dataset, const ColmapModel& model) {
  std::vector<bool> is_test(model.images.size(), false);
  for (const std::string& name : separated(dataset.test_names)) {
    bool is_found = false;
    for (std::size_t i = 0; i < is_test.size(); ++i)
      if (is_meant(name, model.images[i].name)) is_test[i] = is_found = true;
    if (!is_found)
      throw UsageError(fmt::format(
          "dataset.test_names has {}, but no image in {} has this name; the first image is {}",
          name, model.folder.string(), model.images.front().name));
  }
  if (std::find(is_test.begin(), is_test.end(), false) == is_test.end())
    throw UsageError(
        fmt::format("no view is left to train on: dataset.test_names holds out all {}; name fewer, "
                    "or train without dataset.eval",
                    is_test.size()));
  return is_test;
}

void sort_by_name(ColmapModel& model) {
  std::sort(model.images.begin(), model.images.end(),
            [](const ColmapImage& a, const ColmapImage& b) { return a.name < b.name; });
}

/// Names that were written on another machine become those of files here.
void localize_names(ColmapModel& model, const fs::path& images) {
  for (ColmapImage& image : model.images) image.name = name_below(images, image.name);
}

// --- Checks

/// Image names lead to files below the images folder, here and wherever a run writes pictures by
/// view name.
void check_name(const ColmapImage& image, const fs::path& model) {
  const fs::path name = image.name;
  if (name.is_absolute() || std::find(name.begin(), name.end(), "..") != name.end())
    throw Error(
        fmt::format("cannot use the model in {}: image name '{}' leads out of the images folder; "
                    "rename it in the model",
                    model.string(), image.name));
}

/// Takes images out of the scene.
void keep_images(SceneModel& scene, const std::vector<bool>& is_lost) {
  std::size_t kept = 0;
  for (std::size_t i = 0; i < is_lost.size(); ++i) {
    if (is_lost[i]) continue;
    if (kept != i) {
      scene.model.images[kept] = std::move(scene.model.images[i]);
      scene.photos[kept] = std::move(scene.photos[i]);
      scene.is_test[kept] = scene.is_test[i];
    }
    ++kept;
  }
  scene.model.images.resize(kept);
  scene.photos.resize(kept);
  scene.is_test.resize(kept);
  if (std::find(scene.is_test.begin(), scene.is_test.end(), false) == scene.is_test.end())
    throw Error(
        fmt::format("no view is left to train on: all training photos of {} are missing or "
                    "cut short; copy them again",
                    scene.model.folder.string()));
}

/// A few photos that were deleted or cut short cost themselves, and not the run. The split of the
/// others stays.
void leave_out_lost(const SceneFolders& folders, SceneModel& scene) {
  const LostPhotos lost = lost_photos(scene.model, scene.photos);
  if (!lost.are_few) {
    if (!lost.missing.empty()) fail_missing_photos(scene.model, scene.photos, folders.images);
    return;  // the reader of the first one says what it is
  }
  std::vector<bool> is_lost(scene.photos.size(), false);
  std::string names;
  for (const auto* some : {&lost.missing, &lost.cut_short})
    for (const std::size_t i : *some) {
      is_lost[i] = true;
      names += (names.empty() ? "" : ", ") + scene.model.images[i].name +
               (some == &lost.missing ? " (missing)" : " (cut short)");
    }
  if (names.empty()) return;
  log_warning("{} of {} left out, because the files in {} are missing or cut short: {}",
              lost.missing.size() + lost.cut_short.size(),
              counted(scene.photos.size(), "photo", "is", "are"), folders.images.string(), names);
  keep_images(scene, is_lost);
}

/// Refuses a model with next to none of the photos: COLMAP gave up, or began another model.
void check_registered(const ColmapModel& model, const fs::path& images) {
  constexpr std::size_t kFewRegistered = 3;  // fewer are suspicious
  constexpr std::size_t kManyTimes = 3;      // as many photos or more are "many more"
  const std::size_t registered = model.images.size();
  if (registered >= kFewRegistered) return;
  const std::size_t photos = picture_names_in(images).size();
  if (photos < kManyTimes * registered) return;
  throw Error(fmt::format(
      "the model in {} holds only {} of the {} photos in {}: COLMAP could not register the others; "
      "run COLMAP again (exhaustive matching, or photos that overlap more), or use this model "
      "nevertheless by naming it with --set dataset.model=FOLDER",
      model.folder.string(), registered, photos, images.string()));
}

}  // namespace

std::vector<std::size_t> frame_numbers(const ColmapModel& model) {
  std::unordered_map<std::uint64_t, std::size_t> frame_of_image;  // index in model.frames
  for (std::size_t frame = 0; frame < model.frames.size(); ++frame)
    for (std::uint64_t image : model.frames[frame].image_ids) frame_of_image[image] = frame;

  std::unordered_map<std::size_t, std::size_t> number_of_frame;
  std::vector<std::size_t> numbers;
  std::size_t next = 0;
  for (const ColmapImage& image : model.images) {
    const auto frame = frame_of_image.find(image.id);
    const bool is_new =
        frame == frame_of_image.end() || number_of_frame.try_emplace(frame->second, next).second;
    numbers.push_back(is_new ? next++ : number_of_frame.at(frame->second));
  }
  return numbers;
}

std::vector<bool> test_views_of(const DatasetConfig& dataset, const ColmapModel& model) {
  if (model.images.empty())
    throw Error(fmt::format(
        "the model in {} has no images; run COLMAP again or name another model with --set "
        "dataset.model=FOLDER",
        model.folder.string()));
  std::vector<bool> is_test(model.images.size(), false);
  if (!dataset.eval && !dataset.test_names.empty())
    log_warning("dataset.test_names holds nothing out without --eval");
  if (!dataset.eval) return is_test;
  if (!dataset.test_names.empty()) return split_by_names(dataset, model);
  if (dataset.test_every < 1)
    throw UsageError(fmt::format("dataset.test_every is {}; give 2 or more", dataset.test_every));

  const std::vector<std::size_t> numbers = frame_numbers(model);
  for (std::size_t i = 0; i < is_test.size(); ++i)
    is_test[i] = numbers[i] % std::size_t(dataset.test_every) == 0;

  const std::size_t frames = 1 + *std::max_element(numbers.begin(), numbers.end());
  const bool has_rigs = frames < numbers.size();
  if (std::find(is_test.begin(), is_test.end(), false) == is_test.end())
    throw UsageError(
        fmt::format("no view is left to train on: dataset.eval holds out every {}th of {}{}; raise "
                    "dataset.test_every, or train without dataset.eval",
                    dataset.test_every, frames, has_rigs ? " rig frames" : ""));
  if (has_rigs)
    log_info("{} photos in {} rig frames: test views are held out by whole frames", numbers.size(),
             frames);
  return is_test;
}

std::string text_of_no_points(int random_points) {
  return fmt::format(
      "the model has no points: training starts from {} random ones, which takes longer and gives "
      "a "
      "worse result; `gemsplat reconstruct SCENE -o NEW` makes a scene with points for these "
      "cameras, with COLMAP",
      random_points);
}

LostPhotos lost_photos(const ColmapModel& model, const std::vector<fs::path>& photos) {
  LostPhotos lost;
  std::vector<char> is_cut(photos.size(), false);
  parallel_for(photos.size(), 1, [&](std::size_t i) {
    if (!photos[i].empty() && model.images[i].video.empty()) is_cut[i] = is_cut_short(photos[i]);
  });
  for (std::size_t i = 0; i < photos.size(); ++i) {
    if (photos[i].empty()) lost.missing.push_back(i);
    if (is_cut[i]) lost.cut_short.push_back(i);
  }
  lost.are_few =
      double(lost.missing.size() + lost.cut_short.size()) <= kMostLost * double(photos.size());
  return lost;
}

SceneModel read_model_and_split(const DatasetConfig& dataset, const SceneFolders& folders,
                                Tracks tracks) {
  SceneModel scene;
  TransformsScene transforms;
  if (folders.kind == SceneKind::colmap) {
    if (dataset.exposure || dataset.refine_cameras) tracks = Tracks::read;
    scene.model = read_colmap_model(folders.model, tracks);
  } else {
    transforms = read_transforms(folders.model);
    scene.model = std::move(transforms.model);
    scene.time_count = transforms.time_count;
    scene.is_split_by_files = transforms.has_split;
  }
  if (folders.kind == SceneKind::colmap) localize_names(scene.model, folders.images);
  sort_by_name(scene.model);
  const bool follows_files = scene.is_split_by_files && dataset.eval && dataset.test_names.empty();
  scene.is_test =
      follows_files ? split_of_files(transforms, scene.model) : test_views_of(dataset, scene.model);
  return scene;
}

void find_times(const DatasetConfig& dataset, const SceneFolders& folders, SceneModel& scene) {
  if (dataset.times == PhotoTimes::none) return;
  if (folders.kind != SceneKind::colmap)
    throw UsageError(
        "dataset.times is for COLMAP models; the frames of a transforms.json have a `time` of "
        "their own");
  if (dataset.times == PhotoTimes::names) {
    scene.time_count = set_times_by_name(scene.model);
    return;
  }
  if (dataset.refine_cameras || dataset.exposure)
    throw UsageError(
        "dataset.times = \"frames\" goes neither with --refine-cameras nor with --exposure: the "
        "points were seen in one frame of each camera only; refine the scene before, without "
        "dataset.times");
  scene.time_count = add_frames_of_cameras(folders.images, scene.model, scene.is_test);
}

void move_near_origin(SceneModel& scene) {
  scene.world_offset = world_offset_of(scene.model);
  if (scene.world_offset != Vec3d(0.0)) take_off(scene.model, scene.world_offset);
}

void find_scene_files(const DatasetConfig& dataset, const SceneFolders& folders,
                      SceneModel& scene) {
  for (const ColmapImage& image : scene.model.images) check_name(image, scene.model.folder);
  scene.photos = match_photos(scene.model, folders.images);
  leave_out_lost(folders, scene);
  std::vector<std::string> names;
  std::vector<fs::path> masks_of_model, depth_of_model;
  for (const ColmapImage& image : scene.model.images) {
    names.push_back(image.name);
    masks_of_model.push_back(image.mask);
    depth_of_model.push_back(image.depth);
  }
  scene.masks = find_masks(dataset, folders);
  scene.mask_files = match_masks(scene.masks, names, scene.photos, masks_of_model);
  scene.depth = find_depth(dataset, folders);
  scene.depth_files = match_depth(scene.depth, names, scene.photos, depth_of_model);
}

SceneModel read_scene_model(const DatasetConfig& dataset, const SceneFolders& folders,
                            Tracks tracks) {
  if (!find_depth(dataset, folders).folder.empty()) tracks = Tracks::read;
  SceneModel scene = read_model_and_split(dataset, folders, tracks);
  move_near_origin(scene);
  if (dataset.model.empty() && dataset.times != PhotoTimes::frames)
    check_registered(scene.model, folders.images);
  find_times(dataset, folders, scene);
  find_scene_files(dataset, folders, scene);
  return scene;
}

}  // namespace gs
