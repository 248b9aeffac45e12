// SPDX-License-Identifier: Apache-2.0
#include "data_loaders/scene/depth/depth_files.h"

#include <spdlog/fmt/fmt.h>

#include <set>

#include "data_loaders/photos/photo_names.h"
#include "data_loaders/scene/files_of_photos.h"
#include "gs_core/error.h"
#include "gs_core/system/log.h"

namespace gs {
namespace {

namespace fs = std::filesystem;

constexpr const char* kDefaultFolder = "depth";
constexpr const char* kNone = "none";

}  // namespace

DepthSource find_depth(const DatasetConfig& dataset, const SceneFolders& folders) {
  DepthSource source;
  source.images = folders.images;
  source.kind = dataset.depth_kind;
  source.unit = dataset.depth_unit;
  source.is_used = dataset.depth != kNone;
  if (!source.is_used) return source;
  source.is_named = !dataset.depth.empty();
  source.folder =
      fs::path(dataset.source) / (source.is_named ? dataset.depth : std::string(kDefaultFolder));
  std::error_code ignored;
  if (fs::is_directory(source.folder, ignored)) return source;
  if (source.is_named)
    throw Error(fmt::format(
        "cannot find the depth maps of {}: there is no folder {}; name another one with "
        "--set dataset.depth=FOLDER, or none of them with --set dataset.depth=none",
        dataset.source, source.folder.string()));
  source.folder.clear();
  return source;
}

std::vector<fs::path> match_depth(const DepthSource& source, const std::vector<std::string>& names,
                                  const std::vector<fs::path>& photos,
                                  const std::vector<fs::path>& of_model) {
  std::vector<fs::path> maps(names.size());
  if (!source.is_used) return maps;
  if (!source.is_named) maps = of_model;
  if (source.folder.empty() || names.empty()) return maps;
  std::vector<std::string> file_names;
  for (const fs::path& photo : photos)
    file_names.push_back(photo.lexically_relative(source.images).generic_string());
  std::set<std::string> photo_names(names.begin(), names.end());
  photo_names.insert(file_names.begin(), file_names.end());
  const FilesOfPhotos files("depth", source.folder, source.images, photo_names);
  std::size_t missing = 0;
  for (std::size_t i = 0; i < names.size(); ++i) {
    if (!maps[i].empty()) continue;
    std::string found = files.of(names[i]);
    if (found.empty() && file_names[i] != names[i]) found = files.of(file_names[i]);
    if (found.empty())
      ++missing;
    else
      maps[i] = source.folder / found;
  }
  if (missing < names.size()) return maps;
  const std::string nothing_matches = fmt::format(
      "none of the {} pictures in {} is the depth map of a photo: that of {} would be {}.png "
      "there, "
      "or {}.png, or .exr in place of .png",
      files.count(), source.folder.string(), names[0], without_extension(names[0]), names[0]);
  if (source.is_named) throw Error(nothing_matches);
  log_warning("{}", nothing_matches);
  return maps;
}

}  // namespace gs
