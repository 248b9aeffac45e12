// SPDX-License-Identifier: Apache-2.0
#include "data_loaders/find_scene.h"

#include <spdlog/fmt/fmt.h>

#include <algorithm>
#include <optional>
#include <vector>

#include "data_loaders/colmap_model.h"
#include "gs_core/error.h"

namespace gs {
namespace {

namespace fs = std::filesystem;

bool is_folder(const fs::path& path) {
  std::error_code ignored;
  return fs::is_directory(path, ignored);
}

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

/// Where a scene's model may lie, in the order in which it is looked for.
std::vector<fs::path> model_places(const fs::path& scene) {
  return {scene / "sparse" / "0", scene / "sparse", scene};
}

std::optional<fs::path> first_model(const std::vector<fs::path>& places) {
  const auto found = std::find_if(places.begin(), places.end(), is_colmap_model);
  return found == places.end() ? std::nullopt : std::optional(*found);
}

/// What to try instead of a folder without a model.
std::string nearest_model(const fs::path& source) {
  for (const fs::path& folder : folders_in(source / "sparse"))
    if (is_colmap_model(folder))
      return fmt::format("there is one in {}: take it with --set dataset.model={}", folder.string(),
                         folder.lexically_relative(source).string());
  std::vector<fs::path> neighbours = folders_in(source);
  neighbours.insert(neighbours.begin(), parent_of(source));
  for (const fs::path& scene : neighbours)
    if (first_model(model_places(scene)))
      return fmt::format("{} has one: train on that", scene.string());
  return "name it with --set dataset.model=FOLDER, or make one with COLMAP";
}

/// What to try instead of a folder without photos.
std::string nearest_images(const fs::path& source, const fs::path& images) {
  std::vector<fs::path> neighbours = folders_in(source);
  const fs::path parent = parent_of(source);
  neighbours.insert(neighbours.begin(), {parent, parent_of(parent)});
  for (const fs::path& scene : neighbours)
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
    throw Error(fmt::format("cannot find the scene {}: there is no such folder; check the path",
                            dataset.source));

  const std::vector<fs::path> places =
      dataset.model.empty() ? model_places(source)
                            : std::vector{source / dataset.model, fs::path(dataset.model)};
  const std::optional<fs::path> model = first_model(places);
  if (!model)
    throw Error(
        fmt::format("cannot find a scene in {}: there is no COLMAP model (cameras and images, .bin "
                    "or .txt) in {}; {}",
                    dataset.source, joined(places), nearest_model(source)));
  const fs::path images = source / dataset.images;
  if (!is_folder(images))
    throw Error(fmt::format("cannot find the photos of {}: there is no folder {}; {}",
                            dataset.source, images.string(),
                            nearest_images(source, dataset.images)));
  return {*model, images};
}

}  // namespace gs
