// SPDX-License-Identifier: Apache-2.0
#include "data_loaders/scene/scene_model.h"

#include <spdlog/fmt/fmt.h>

#include <algorithm>
#include <set>
#include <sstream>
#include <unordered_map>

#include "data_loaders/colmap/world_offset.h"
#include "data_loaders/foreign/foreign_scene.h"
#include "data_loaders/photos/photo_names.h"
#include "data_loaders/points/points_beside.h"
#include "data_loaders/transforms/transforms_json.h"
#include "gs_core/error.h"
#include "gs_core/system/log.h"
#include "gs_core/system/text/ascii.h"

namespace gs {
namespace {

namespace fs = std::filesystem;

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

/// How dataset.masks and dataset.mask_mode use masks.
MaskUse mask_use_of(const DatasetConfig& dataset, SceneKind kind) {
  const bool over_background =
      dataset.mask_mode == MaskMode::background ||
      (dataset.mask_mode == MaskMode::automatic && kind == SceneKind::blender);
  return {dataset.masks != "none", over_background, dataset.invert_masks};
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

SceneModel read_scene(const DatasetConfig& dataset, const SceneFolders& folders, Tracks tracks) {
  SceneModel scene;
  scene.folders = folders;
  TransformsScene transforms;
  if (folders.kind == SceneKind::colmap) {
    scene.model = read_colmap_model(folders.model, tracks);
    localize_names(scene.model, folders.images);
  } else if (folders.kind == SceneKind::foreign) {
    scene.model = read_foreign_scene(folders.model, folders.images);
    if (scene.model.points.empty())
      scene.model.points = points_beside(scene.model, dataset.source, folders.model);
  } else {
    transforms = read_transforms(folders.model);
    scene.model = std::move(transforms.model);
    if (!dataset.rolling_shutter)
      for (ColmapImage& image : scene.model.images) image.motion = {};
    scene.time_count = transforms.time_count;
    scene.is_split_by_files = transforms.has_split;
  }
  sort_by_name(scene.model);
  const bool follows_files = scene.is_split_by_files && dataset.eval && dataset.test_names.empty();
  const std::vector<bool> is_test =
      follows_files ? split_of_files(transforms, scene.model) : test_views_of(dataset, scene.model);
  for (std::size_t i = 0; i < is_test.size(); ++i) {
    Photo& photo = scene.photos.emplace_back();
    photo.name = scene.model.images[i].name;
    photo.is_test = is_test[i];
    photo.masks = mask_use_of(dataset, folders.kind);
    photo.depth_kind = dataset.depth_kind;
    photo.depth_unit = dataset.depth_unit;
  }
  return scene;
}

void move_near_origin(SceneModel& scene) {
  scene.world_offset = world_offset_of(scene.model);
  if (scene.world_offset != Vec3d(0.0)) take_off(scene.model, scene.world_offset);
}

}  // namespace gs
