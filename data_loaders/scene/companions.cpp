// SPDX-License-Identifier: Apache-2.0
#include "data_loaders/scene/companions.h"

#include <spdlog/fmt/fmt.h>

#include <algorithm>
#include <map>
#include <set>

#include "data_loaders/counted.h"
#include "data_loaders/photos/photo_names.h"
#include "gs_core/error.h"
#include "gs_core/system/files/access.h"
#include "gs_core/system/log.h"

namespace gs {

namespace fs = std::filesystem;

const CompanionKind kMasks{
    "mask",
    "mask",
    "masks",
    "--masks",
    "--masks none",
    &DatasetConfig::masks,
    &ColmapImage::mask,
    &Photo::mask_file,
    &SceneModel::masks,
    "the mask of {0} would be {0}.png there, or {1}.png, {1}.mask.png, {1}_mask.png",
    "{} of {} {} no mask in {}; all their pixels are trained, except where alpha masks them: {}{}"};
const CompanionKind kDepthMaps{
    "depth",
    "depth map",
    "depth",
    "--set dataset.depth=FOLDER",
    "--set dataset.depth=none",
    &DatasetConfig::depth,
    &ColmapImage::depth,
    &Photo::depth_file,
    &SceneModel::depth,
    "that of {0} would be {1}.png there, or {0}.png, or .exr in place of .png",
    nullptr};
const CompanionKind kNormalMaps{
    "normal",
    "normal map",
    "normals",
    "--set dataset.normals=FOLDER",
    "--set surface.prior_weight=0",
    &DatasetConfig::normals,
    nullptr,
    &Photo::normal_file,
    &SceneModel::normals,
    "that of {0} would be {1}.png there, or {0}.png, or .exr in place of .png",
    nullptr};

namespace {

/// The pictures of a folder, by the photos whose companions they could be.
class CompanionFiles {
 public:
  CompanionFiles(const CompanionKind& kind, const SceneModel& scene)
      : kind_(kind), folder_((scene.*kind.source).folder) {
    for (const Photo& photo : scene.photos)
      photo_names_.insert({photo.name, file_name(photo, scene)});
    std::error_code ignored;
    const bool has_photos = fs::equivalent(folder_, scene.folders.images, ignored);
    for (std::string& name : picture_names_in(folder_)) {
      if (has_photos && photo_names_.contains(name)) continue;
      by_stem_[without_extension(name)].push_back(name);
      names_.insert(std::move(name));
    }
  }

  static std::string file_name(const Photo& photo, const SceneModel& scene) {
    return photo.file.lexically_relative(scene.folders.images).generic_string();
  }

  std::size_t count() const { return names_.size(); }

  /// The file of the photo of that name, relative to the folder; empty if there is none.
  std::string of(const std::string& photo) const {
    const std::string stem = without_extension(photo);
    std::string found = one_of(photo, photo, false);
    if (found.empty() && names_.contains(photo)) found = photo;
    if (found.empty()) found = one_of(stem, photo, true);
    for (const char mark : {'.', '_'})
      for (const std::string& begin : {stem, photo})
        if (found.empty()) found = one_of(begin + mark + kind_.suffix, photo, false);
    return found;
  }

 private:
  /// The file with this name, whatever its ending. With `spare_others`, files that have the name of
  /// another photo do not count.
  std::string one_of(const std::string& stem, const std::string& photo, bool spare_others) const {
    const auto found = by_stem_.find(stem);
    if (found == by_stem_.end()) return "";
    std::vector<std::string> files = found->second;
    if (spare_others)
      std::erase_if(files, [&](const std::string& file) { return photo_names_.contains(file); });
    if (files.size() > 1) {
      const std::string png = stem + ".png";
      if (std::find(files.begin(), files.end(), png) != files.end()) return png;
      throw Error(fmt::format("photo '{}' could have two {}s in {}: {} and {}; leave one there",
                              photo, kind_.noun, folder_.string(), files[0], files[1]));
    }
    return files.empty() ? "" : files[0];
  }

  const CompanionKind& kind_;
  fs::path folder_;
  std::set<std::string> photo_names_, names_;
  std::map<std::string, std::vector<std::string>> by_stem_;
};

}  // namespace

Companions find_companions(const CompanionKind& kind, const DatasetConfig& dataset) {
  const std::string& setting = dataset.*kind.setting;
  Companions source;
  source.is_used = setting != "none";
  if (!source.is_used) return source;
  source.is_named = !setting.empty();
  const fs::path folder = fs::path(dataset.source) / (source.is_named ? setting : kind.folder);
  if (is_folder(folder))
    source.folder = folder;
  else if (source.is_named)
    throw Error(
        fmt::format("cannot find the {}s of {}: there is no folder {}; name another one with {}, "
                    "or none of them with {}",
                    kind.noun, dataset.source, folder.string(), kind.flag, kind.none));
  return source;
}

void match_companions(const CompanionKind& kind, const DatasetConfig& dataset, SceneModel& scene) {
  const Companions& source = scene.*kind.source = find_companions(kind, dataset);
  if (source.is_used && !source.is_named && kind.of_model)
    for (std::size_t i = 0; i < scene.photos.size(); ++i)
      scene.photos[i].*kind.file = scene.model.images[i].*kind.of_model;
  if (source.folder.empty() || scene.photos.empty()) return;
  const CompanionFiles files(kind, scene);
  std::vector<std::string> missing;
  for (Photo& photo : scene.photos) {
    if (!(photo.*kind.file).empty()) continue;
    std::string found = files.of(photo.name);
    if (found.empty()) found = files.of(CompanionFiles::file_name(photo, scene));
    if (found.empty())
      missing.push_back(photo.name);
    else
      photo.*kind.file = source.folder / found;
  }
  const std::size_t count = scene.photos.size();
  if (missing.size() == count) {
    const std::string& first = scene.photos[0].name;
    const std::string nothing_matches =
        fmt::format("none of the {} pictures in {} is the {} of a photo: {}", files.count(),
                    source.folder.string(), kind.noun,
                    fmt::format(fmt::runtime(kind.names), first, without_extension(first)));
    if (source.is_named) throw Error(nothing_matches);
    log_warning("{}", nothing_matches);
  } else if (kind.partial && !missing.empty()) {
    const std::string text =
        fmt::format(fmt::runtime(kind.partial), missing.size(), counted(count, "photo"),
                    missing.size() == 1 ? "has" : "have", source.folder.string(), missing[0],
                    missing.size() > 1 ? ", ..." : "");
    if (masks_may_be_lost(missing.size(), count))
      log_warning("{}", text);
    else
      log_info("{}", text);
  }
}

}  // namespace gs
