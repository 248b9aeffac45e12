// SPDX-License-Identifier: Apache-2.0
#include "gs_app/studio/chosen_photos.h"

#include <spdlog/fmt/fmt.h>

#include <algorithm>
#include <map>
#include <set>

#include "data_loaders/photos/orientation.h"
#include "data_loaders/photos/photo_names.h"
#include "data_loaders/reconstruct/photo_walk.h"
#include "data_loaders/scene/find_scene.h"
#include "data_loaders/scene/photo_list.h"
#include "data_loaders/scene/scene_model.h"
#include "gs_core/error.h"
#include "gs_core/system/files/access.h"
#include "gs_core/threads/parallel.h"

namespace gs {
namespace {

namespace fs = std::filesystem;

// What the copy of a turned photo is called: formats that copies are not written in get one more
// ending.
std::string name_of_copy(const std::string& photo) {
  const std::string ending = lowercase_ending(photo);
  if (ending == ".jpg" || ending == ".jpeg" || ending == ".png") return photo;
  const bool is_lossy = ending == ".heic" || ending == ".heif" || ending == ".avif";
  return photo + (is_lossy ? ".jpg" : ".png");
}

fs::path path_of_copy(const Project& project, const std::string& photo, int degrees) {
  return project.folder / "turned" / std::to_string(degrees) / name_of_copy(photo);
}

// A copy has the time of the photo that it was made of.
void make_turned_copy(const Project& project, const std::string& name, int degrees) {
  const fs::path photo = photo_folder_of(project) / name,
                 copy = path_of_copy(project, name, degrees);
  const fs::file_time_type time = fs::last_write_time(photo);
  if (is_file(copy) && fs::last_write_time(copy) == time) return;
  write_copy(photo, turned(read_upright(photo), degrees), copy);
  fs::last_write_time(copy, time);
}

void link_photo(const fs::path& from, const fs::path& to) {
  if (is_there(to))
    throw UsageError(to.filename().string() +
                     " would be two photos, one of them turned; leave one of the two out");
  fs::create_directories(to.parent_path());
  std::error_code error;
  fs::create_hard_link(from, to, error);
  if (error) fs::create_symlink(fs::absolute(from), to);
}

// Finds the project's photo of a name in a scene, which may have another ending: `reconstruct` makes
// a.jpg of a.heic, and a.heic.jpg is the copy of a turned one.
class PhotoNames {
 public:
  explicit PhotoNames(const Project& project) {
    for (std::string& name : photos_of(project)) {
      ++by_stem_.try_emplace(without_extension(name), name, 0).first->second.second;
      names_.insert(std::move(name));
    }
  }
  std::string of(const std::string& name) const {
    const std::string stem = without_extension(name);
    if (names_.contains(name)) return name;
    if (names_.contains(stem)) return stem;
    const auto at = by_stem_.find(stem);
    return at != by_stem_.end() && at->second.second == 1 ? at->second.first : "";
  }

 private:
  std::set<std::string> names_;
  std::map<std::string, std::pair<std::string, int>> by_stem_;  // a photo, and how many there are
};

}  // namespace

fs::path photo_folder_of(const Project& project) {
  return is_folder(project.input()) ? photo_root(project.input()) : project.input();
}

std::vector<std::string> photos_of(const Project& project) {
  const fs::path folder = photo_folder_of(project);
  std::vector<std::string> names = picture_names_in(folder);
  std::erase_if(names, [&](const auto& name) { return !is_scene_photo(folder / name, folder); });
  return names;
}

bool is_turn(int degrees) { return degrees >= 0 && degrees < 360 && degrees % 90 == 0; }

void make_turned_copies(const Project& project) {
  const std::vector<std::string> photos = photos_of(project);
  std::vector<std::pair<std::string, int>> wanted;
  for (const auto& [name, degrees] : project.turned)
    if (std::binary_search(photos.begin(), photos.end(), name)) wanted.emplace_back(name, degrees);
  parallel_for(wanted.size(), 1, [&](std::size_t i) {
    make_turned_copy(project, wanted[i].first, wanted[i].second);
  });
}

void choose_photos(const Project& project, int job) {
  const fs::path chosen = project.folder / fmt::format("chosen-{}", job),
                 from = photo_folder_of(project);
  const std::set<std::string> left_out(project.left_out.begin(), project.left_out.end());
  fs::remove_all(chosen);
  for (const std::string& name : photos_of(project)) {
    if (left_out.contains(name)) continue;
    const auto turn = project.turned.find(name);
    if (turn == project.turned.end()) {
      link_photo(from / name, chosen / name);
    } else {
      make_turned_copy(project, name, turn->second);
      link_photo(path_of_copy(project, name, turn->second), chosen / name_of_copy(name));
    }
  }
}

std::vector<ScenePhoto> photos_of_scene(const Project& project, const std::string& scene) {
  DatasetConfig dataset;
  dataset.source = (project.folder / scene).string();  // an absolute scene stays
  const SceneFolders folders = find_scene(dataset);
  const PhotoNames names(project);
  const fs::path own = photo_folder_of(project).lexically_normal();
  const bool is_own = is_own_scene(project, scene);
  std::vector<ScenePhoto> photos;
  for (const ColmapImage& image : read_scene(dataset, folders).model.images) {
    const fs::path file = (folders.images / image.name).lexically_normal();
    const std::string name =
        is_own ? file.lexically_relative(own).generic_string() : std::string(image.name);
    photos.push_back({image.name, names.of(name), !image.mask.empty()});
  }
  return photos;
}

bool is_own_scene(const Project& project, const std::string& scene) {
  std::error_code none;
  return fs::equivalent(project.folder / scene, project.input(), none);
}

bool write_chosen_list(const Project& project, const std::vector<ScenePhoto>& photos) {
  const std::set<std::string> left_out(project.left_out.begin(), project.left_out.end());
  std::vector<std::string> names;
  for (const ScenePhoto& photo : photos)
    if (!left_out.contains(photo.photo)) names.push_back(photo.name);
  if (names.size() == photos.size()) return false;
  if (names.empty()) throw UsageError("all photos of the scene are left out; take some in again");
  write_photo_list(project.folder / "photos.txt", names);
  return true;
}

}  // namespace gs
