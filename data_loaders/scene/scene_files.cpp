// SPDX-License-Identifier: Apache-2.0
#include "data_loaders/scene/scene_files.h"

#include <spdlog/fmt/fmt.h>

#include <algorithm>
#include <set>
#include <unordered_map>
#include <unordered_set>

#include "data_loaders/counted.h"
#include "data_loaders/photos/photo_names.h"
#include "data_loaders/scene/files_of_photos.h"
#include "data_loaders/scene/photo_times.h"
#include "gs_core/error.h"
#include "gs_core/system/files/access.h"
#include "gs_core/system/log.h"
#include "gs_core/system/text/ascii.h"

namespace gs {
namespace {

namespace fs = std::filesystem;

constexpr const char* kDefaultFolder = "masks";  // of masks
constexpr const char* kNone = "none";

std::string lower_without_extension(const std::string& name) {
  return lowercase(without_extension(name));
}

// --- Photos

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

[[noreturn]] void fail_missing(const std::set<std::string>& missing, std::size_t name_count,
                               const std::vector<std::string>& unused, const fs::path& folder) {
  constexpr std::size_t kMostNamed = 10;
  std::string list;
  std::size_t named = 0;
  for (const std::string& name : missing) {
    if (named++ == kMostNamed) break;
    list += (list.empty() ? "" : ", ") + name;
  }
  if (missing.size() > kMostNamed) list += fmt::format(" and {} more", missing.size() - kMostNamed);
  const std::string others =
      unused.empty() ? ""
                     : fmt::format(" ({} not in the model or match several names: {}{})",
                                   counted(unused.size(), "photo", "there is", "there are"),
                                   unused.front(), unused.size() > 1 ? ", ..." : "");
  throw Error(fmt::format("{} of the model's {} photos {} not in {}: {}{}; {}", missing.size(),
                          name_count, missing.size() == 1 ? "is" : "are", folder.string(), list,
                          others, remedy_of_missing(*missing.begin(), folder)));
}

// --- Masks

/// The message for a folder without the mask of any photo.
std::string nothing_matches(const MaskSource& source, std::size_t count,
                            const std::string& first_name) {
  return fmt::format(
      "none of the {} pictures in {} is the mask of a photo: the mask of {} would be {}.png there, "
      "or {}.png, {}.mask.png, {}_mask.png",
      count, source.folder.string(), first_name, first_name, without_extension(first_name),
      without_extension(first_name), without_extension(first_name));
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

std::vector<std::string> pictures_besides(const std::vector<fs::path>& files,
                                          const fs::path& folder) {
  std::unordered_set<std::string> taken;
  for (const fs::path& file : files) taken.insert(file.lexically_relative(folder).generic_string());
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

std::vector<fs::path> match_photos(const ColmapModel& model, const fs::path& folder) {
  std::vector<std::string> names;
  for (const ColmapImage& image : model.images)
    if (image.video.empty()) names.push_back(image.name);
  const std::vector<fs::path> photos = match_photos(names, folder);
  std::vector<fs::path> paths;
  std::size_t next = 0;
  for (const ColmapImage& image : model.images)
    paths.push_back(image.video.empty() ? photos[next++] : image.video);
  return paths;
}

void fail_missing_photos(const ColmapModel& model, const std::vector<fs::path>& paths,
                         const fs::path& folder) {
  std::set<std::string> missing;
  for (std::size_t i = 0; i < paths.size(); ++i)
    if (paths[i].empty()) missing.insert(model.images[i].name);
  fail_missing(missing, paths.size(), pictures_besides(paths, folder), folder);
}

MaskSource find_masks(const DatasetConfig& dataset, const SceneFolders& folders) {
  MaskSource source;
  source.images = folders.images;
  source.invert = dataset.invert_masks;
  source.over_background =
      dataset.mask_mode == MaskMode::background ||
      (dataset.mask_mode == MaskMode::automatic && folders.kind == SceneKind::blender);
  if (dataset.masks == kNone) {
    source.use_alpha = false;
    return source;
  }
  source.is_named = !dataset.masks.empty();
  source.folder =
      fs::path(dataset.source) / (source.is_named ? dataset.masks : std::string(kDefaultFolder));
  if (is_folder(source.folder)) return source;
  if (source.is_named)
    throw Error(
        fmt::format("cannot find the masks of {}: there is no folder {}; name another one "
                    "with --masks, or none of them with --masks none",
                    dataset.source, source.folder.string()));
  source.folder.clear();
  return source;
}

std::vector<fs::path> match_masks(const MaskSource& source, const std::vector<std::string>& names,
                                  const std::vector<fs::path>& photos,
                                  const std::vector<fs::path>& of_model) {
  std::vector<fs::path> masks(names.size());
  if (!source.is_named && source.use_alpha) masks = of_model;
  if (source.folder.empty() || names.empty()) return masks;
  std::vector<std::string> file_names;
  for (const fs::path& photo : photos)
    file_names.push_back(photo.lexically_relative(source.images).generic_string());
  std::set<std::string> photo_names(names.begin(), names.end());
  photo_names.insert(file_names.begin(), file_names.end());
  const FilesOfPhotos files("mask", source.folder, source.images, photo_names);
  std::size_t missing = 0;
  std::string first_missing;
  for (std::size_t i = 0; i < names.size(); ++i) {
    if (!masks[i].empty()) continue;
    std::string found = files.of(names[i]);
    if (found.empty() && file_names[i] != names[i]) found = files.of(file_names[i]);
    if (!found.empty())
      masks[i] = source.folder / found;
    else if (missing++ == 0)
      first_missing = names[i];
  }
  if (missing == names.size() && source.is_named)
    throw Error(nothing_matches(source, files.count(), names[0]));
  if (missing == names.size())
    log_warning("{}", nothing_matches(source, files.count(), names[0]));
  else if (missing > 0)
    log_warning(
        "{} of {} {} no mask in {}; all their pixels are trained, except where alpha masks them: "
        "{}{}",
        missing, counted(names.size(), "photo"), missing == 1 ? "has" : "have",
        source.folder.string(), first_missing, missing > 1 ? ", ..." : "");
  return masks;
}

}  // namespace gs
