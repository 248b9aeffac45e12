// SPDX-License-Identifier: Apache-2.0
#include "data_loaders/scene/find_scene.h"

#include <spdlog/fmt/fmt.h>

#include <algorithm>
#include <utility>
#include <vector>

#include "data_loaders/colmap/colmap_model.h"
#include "data_loaders/foreign/foreign_scene.h"
#include "data_loaders/photos/not_a_folder.h"
#include "data_loaders/photos/photo_names.h"
#include "data_loaders/transforms/transforms_json.h"
#include "gs_core/error.h"
#include "gs_core/system/files/access.h"
#include "gs_core/system/log.h"

namespace gs {
namespace {

namespace fs = std::filesystem;

/// The folders inside a folder, sorted.
std::vector<fs::path> folders_in(const fs::path& folder) {
  std::vector<fs::path> result;
  std::error_code error;
  for (fs::directory_iterator entry(folder, error), end; !error && entry != end;
       entry.increment(error))
    if (is_folder(entry->path())) result.push_back(entry->path());
  std::sort(result.begin(), result.end());
  return result;
}

fs::path parent_of(const fs::path& folder) {
  return fs::absolute(folder / "").lexically_normal().parent_path().parent_path();
}

/// The models in a folder that COLMAP's mapper filled: 0, 1, 2, ..., in this order. The mapper
/// begins a new model when it can place no more photos in the last one.
std::vector<fs::path> sub_models(const fs::path& sparse) {
  std::vector<fs::path> models;
  for (const fs::path& folder : colmap_models_in(sparse))
    if (folder.filename().string().find_first_not_of("0123456789") == std::string::npos)
      models.push_back(folder);
  std::stable_sort(models.begin(), models.end(), [](const fs::path& a, const fs::path& b) {
    return a.native().size() < b.native().size();  // 2 before 10
  });
  return models;
}

/// The model with the most photos, the first one among equals.
fs::path largest_model(const std::vector<fs::path>& models, const fs::path& images) {
  if (models.size() == 1) return models[0];
  std::vector<std::pair<std::uint64_t, fs::path>> counted;
  for (const fs::path& model : models) counted.emplace_back(count_colmap_images(model), model);
  std::stable_sort(counted.begin(), counted.end(),
                   [](const auto& a, const auto& b) { return a.first > b.first; });

  const auto name_of = [](const fs::path& model) {
    return (model.parent_path().filename() / model.filename()).string();
  };
  std::string others;
  for (std::size_t i = 1; i < counted.size(); ++i)
    others += fmt::format("{}{} holds {}", i > 1 ? ", " : "", name_of(counted[i].second),
                          counted[i].first);
  log_info("{} holds {} of {} photos; {}", name_of(counted[0].second), counted[0].first,
           picture_names_in(images).size(), others);
  return counted[0].second;
}

/// The places of a scene's model, in the order of the search; 0 stands for any number.
std::vector<fs::path> model_places(const fs::path& scene) {
  return {scene / "sparse" / "0", scene / "sparse", scene / "colmap" / "sparse" / "0", scene};
}

/// The models in the first of the places with any.
std::vector<fs::path> models_of(const fs::path& scene) {
  for (const fs::path& place : model_places(scene)) {
    if (place.filename() == "0") {
      std::vector<fs::path> models = sub_models(place.parent_path());
      if (!models.empty()) return models;
    } else if (is_colmap_model(place)) {
      return {place};
    }
  }
  return {};
}

/// The remedy for a folder without a model.
std::string nearest_model(const fs::path& source) {
  for (const fs::path& folder : folders_in(source / "sparse"))
    if (is_colmap_model(folder))
      return fmt::format("there is one in {}: take it with --set dataset.model={}", folder.string(),
                         folder.lexically_relative(source).string());
  const fs::path scene = nearby_scene(source);
  if (!scene.empty()) return fmt::format("{} has one: train on that", scene.string());
  return "name it with --set dataset.model=FOLDER, or make one with `gemsplat reconstruct`";
}

/// The remedy for a folder without photos.
std::string nearest_images(const fs::path& source, const fs::path& images) {
  std::vector<fs::path> neighbors = folders_in(source);
  const fs::path parent = parent_of(source);
  neighbors.insert(neighbors.begin(), {parent, parent_of(parent)});
  for (const fs::path& scene : neighbors)
    if (is_folder(scene / images))
      return fmt::format("there is {}: train on {} or name it with --set dataset.images={}",
                         (scene / images).string(), scene.string(), (scene / images).string());
  return "name it with --set dataset.images=FOLDER";
}

std::string joined(const std::vector<fs::path>& paths) {
  std::string text;
  for (const fs::path& path : paths) text += (text.empty() ? "" : ", ") + path.string();
  return text;
}

}  // namespace

SceneFolders find_scene(const DatasetConfig& dataset) {
  if (dataset.source.empty()) throw UsageError("dataset.source is empty; name the scene's folder");
  const fs::path source = dataset.source;
  if (!is_folder(source))
    throw Error(
        fmt::format("cannot find the scene {}: {}", dataset.source, remedy_of_no_folder(source)));

  check_models_are_visible(source);
  const bool is_named = !dataset.model.empty();
  const std::vector<fs::path> named = {source / dataset.model, fs::path(dataset.model)};
  std::vector<fs::path> models = is_named ? std::vector<fs::path>{} : models_of(source);
  if (is_named) {
    const auto found = std::find_if(named.begin(), named.end(), is_colmap_model);
    if (found != named.end()) models.push_back(*found);
  }
  if (models.empty())
    for (const fs::path& folder : is_named ? named : std::vector<fs::path>{source})
      if (has_transforms(folder))
        return {folder, folder,
                is_blender_scene(folder) ? SceneKind::blender : SceneKind::transforms};
  if (models.empty())
    for (const fs::path& place : is_named ? named : std::vector<fs::path>{source})
      if (const auto foreign = find_foreign_scene(place))
        return {foreign->file, foreign_photos(source, dataset.images), SceneKind::foreign};
  if (models.empty())
    throw Error(fmt::format(
        "cannot find a scene in {}: there is no COLMAP model (cameras and images, .bin "
        "or .txt) and no transforms.json in {}; {}",
        dataset.source, joined(is_named ? named : model_places(source)), nearest_model(source)));
  const fs::path images = source / dataset.images;
  if (!is_folder(images))
    throw Error(fmt::format("cannot find the photos of {}: there is no folder {}; {}",
                            dataset.source, images.string(),
                            nearest_images(source, dataset.images)));
  return {largest_model(models, images), images, SceneKind::colmap};
}

fs::path nearby_scene(const fs::path& folder) {
  std::vector<fs::path> neighbors = folders_in(folder);
  neighbors.insert(neighbors.begin(), parent_of(folder));
  neighbors.push_back(folder / "dense" / "0");  // COLMAP's undistorted photos and their model
  const auto is_scene = [](const fs::path& place) {
    return !models_of(place).empty() || has_transforms(place);
  };
  const auto found = std::find_if(neighbors.begin(), neighbors.end(), is_scene);
  return found == neighbors.end() ? fs::path() : *found;
}

fs::path find_colmap_model(const fs::path& scene) {
  const std::vector<fs::path> models = models_of(scene);
  return models.empty() ? fs::path() : largest_model(models, scene / "images");
}

}  // namespace gs
