// SPDX-License-Identifier: Apache-2.0
#include "data_loaders/reconstruct/photo_walk.h"

#include <unistd.h>

#include <algorithm>
#include <string>

#include "data_loaders/photos/photo_names.h"
#include "gs_core/system/files/access.h"
#include "gs_core/system/log.h"

namespace gs {
namespace {

namespace fs = std::filesystem;

// Folders of other pictures beside the photos (dataset.masks, dataset.depth, dataset.normals).
constexpr const char* kOtherPictures[] = {"masks/", "depth/", "normals/"};

bool is_hidden(const fs::path& path) { return path.filename().string().starts_with('.'); }

// A scene or a run of gemsplat, with pictures of its own.
bool is_ours(const fs::path& folder) {
  std::error_code ignored;
  return fs::exists(folder / "reconstruct.json", ignored) ||
         fs::exists(folder / "cfg_args", ignored);
}

bool has_photos(const fs::path& folder, bool deep) {
  const std::vector<fs::path> files = files_in(folder, deep);
  return std::ranges::any_of(files, [](const fs::path& file) { return is_picture(file); });
}

}  // namespace

std::vector<fs::path> files_in(const fs::path& folder, bool deep, const fs::path& without) {
  std::vector<fs::path> files;
  for (const fs::path& path : entries_of(folder)) {
    std::error_code ignored;
    if (is_hidden(path)) continue;
    if (fs::is_regular_file(path, ignored)) files.push_back(path);
    if (!deep || !fs::is_directory(path, ignored)) continue;
    if (fs::is_symlink(path, ignored)) continue;  // may lead back up
    if (is_ours(path)) continue;
    if (!without.empty() && fs::equivalent(path, without, ignored)) continue;
    if (::access(path.c_str(), R_OK | X_OK) != 0) {  // such as lost+found
      log_warning("{} is left out: it may not be read", path.string());
      continue;
    }
    const std::vector<fs::path> below = files_in(path, deep, without);
    files.insert(files.end(), below.begin(), below.end());
  }
  std::sort(files.begin(), files.end());
  return files;
}

fs::path photo_root(const fs::path& folder) {
  return !has_photos(folder, false) && has_photos(folder / "images", true) ? folder / "images"
                                                                           : folder;
}

bool is_scene_photo(const fs::path& file, const fs::path& root) {
  const std::string name = file.lexically_relative(root).generic_string();
  return is_picture(file) && std::ranges::none_of(kOtherPictures, [&](const char* folder) {
           return name.starts_with(folder);
         });
}

}  // namespace gs
