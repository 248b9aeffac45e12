// SPDX-License-Identifier: Apache-2.0
// What a source without a model is: photos, videos, or something else.
#include <algorithm>

#include "data_loaders/colmap/colmap_model.h"
#include "data_loaders/foreign/foreign_scene.h"
#include "data_loaders/photos/photo_names.h"
#include "data_loaders/reconstruct/photo_folder.h"
#include "data_loaders/reconstruct/photo_walk.h"
#include "data_loaders/video/film_frames.h"

namespace gs {
namespace {

namespace fs = std::filesystem;

bool holds_photos(const fs::path& folder) {
  const fs::path root = photo_root(folder);
  const std::vector<fs::path> files = files_in(root, true);
  return std::ranges::any_of(files, [&](const fs::path& file) {
    return is_scene_photo(file, root) || is_foreign_photo(file);
  });
}

bool has_model(const fs::path& scene) {
  if (is_colmap_model(scene)) return true;
  for (const fs::path& sparse : {scene / "sparse", scene / "colmap" / "sparse"})
    if (is_colmap_model(sparse) || !colmap_models_in(sparse).empty()) return true;
  return false;
}

bool is_pose_file(const fs::path& file) {
  return file.filename().string().starts_with("transforms") && file.extension() == ".json";
}

bool has_poses(const fs::path& folder) {
  const std::vector<fs::path> files = files_in(folder, true);
  return std::ranges::any_of(files, [](const fs::path& file) {
    return is_pose_file(file) || (file.stem() == "cameras" && is_colmap_model(file.parent_path()));
  });
}

}  // namespace

std::vector<fs::path> find_videos(const fs::path& source) {
  std::error_code ignored;
  if (fs::is_regular_file(source, ignored) && is_video(source)) return {source};
  if (!fs::is_directory(source, ignored) || holds_photos(source)) return {};
  std::vector<fs::path> videos = files_in(source, false);
  std::erase_if(videos, [](const fs::path& file) { return !is_video(file); });
  return videos;
}

bool holds_only_photos(const fs::path& folder) {
  check_models_are_visible(folder);
  std::error_code error;
  const bool has_videos = !find_videos(folder).empty();
  if (!fs::is_directory(folder, error)) return has_videos;
  if (!has_videos && !holds_photos(folder)) return false;
  if (has_poses(folder) || has_model(folder) ||
      has_model(fs::absolute(folder / "").lexically_normal() / ".."))
    return false;
  for (fs::directory_iterator entry(folder, error), end; !error && entry != end;
       entry.increment(error))
    if (entry->is_directory(error) && has_model(entry->path())) return false;
  return !find_foreign_scene(folder);
}

}  // namespace gs
