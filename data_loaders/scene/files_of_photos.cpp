// SPDX-License-Identifier: Apache-2.0
#include "data_loaders/scene/files_of_photos.h"

#include <spdlog/fmt/fmt.h>

#include <algorithm>

#include "data_loaders/photos/photo_names.h"
#include "gs_core/error.h"

namespace gs {

namespace fs = std::filesystem;

FilesOfPhotos::FilesOfPhotos(std::string kind, fs::path folder, const fs::path& images,
                             const std::set<std::string>& photo_names)
    : kind_(std::move(kind)), folder_(std::move(folder)), photo_names_(photo_names) {
  std::error_code ignored;
  const bool has_photos = fs::equivalent(folder_, images, ignored);
  for (std::string& name : picture_names_in(folder_)) {
    if (has_photos && photo_names.contains(name)) continue;
    by_stem_[without_extension(name)].push_back(name);
    names_.insert(std::move(name));
  }
}

std::string FilesOfPhotos::of(const std::string& photo) const {
  const std::string stem = without_extension(photo);
  std::string found = one_of(photo, photo, false);
  if (found.empty() && names_.contains(photo)) found = photo;
  if (found.empty()) found = one_of(stem, photo, true);
  for (const std::string& ending : {"." + kind_, "_" + kind_})
    for (const std::string& begin : {stem, photo})
      if (found.empty()) found = one_of(begin + ending, photo, false);
  return found;
}

// The file with this name, whatever its extension. With `spare_others`, files that have the name of
// another photo do not count.
std::string FilesOfPhotos::one_of(const std::string& stem, const std::string& photo,
                                  bool spare_others) const {
  const auto found = by_stem_.find(stem);
  if (found == by_stem_.end()) return "";
  std::vector<std::string> files = found->second;
  if (spare_others)
    std::erase_if(files, [&](const std::string& file) { return photo_names_.contains(file); });
  if (files.size() > 1) {
    const std::string png = stem + ".png";
    if (std::find(files.begin(), files.end(), png) != files.end()) return png;
    throw Error(fmt::format("photo '{}' could have two {}s in {}: {} and {}; leave one there",
                            photo, kind_ == "depth" ? "depth map" : kind_, folder_.string(),
                            files[0], files[1]));
  }
  return files.empty() ? "" : files[0];
}

}  // namespace gs
