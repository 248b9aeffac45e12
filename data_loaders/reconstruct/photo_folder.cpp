// SPDX-License-Identifier: Apache-2.0
#include "data_loaders/reconstruct/photo_folder.h"

#include <spdlog/fmt/fmt.h>
#include <unistd.h>

#include <algorithm>
#include <set>

#include "data_loaders/colmap/colmap_model.h"
#include "data_loaders/counted.h"
#include "data_loaders/photos/orientation.h"
#include "data_loaders/photos/photo_names.h"
#include "data_loaders/video/film_frames.h"
#include "gs_core/access.h"
#include "gs_core/error.h"
#include "gs_core/log.h"

namespace gs {
namespace {

namespace fs = std::filesystem;

// Formats that both COLMAP and gemsplat read.
const std::set<std::string> kPhotoEndings = {".jpg", ".jpeg", ".png", ".bmp", ".tif", ".tiff"};
// Of those, the ones that copies are written in.
const std::set<std::string> kCopyEndings = {".jpg", ".jpeg", ".png"};
constexpr const char* kMasksFolder = "masks/";  // beside the photos; holds no photos (masks.h)

bool is_hidden(const fs::path& path) { return path.filename().string().starts_with('.'); }

// A scene or a run of gemsplat, with pictures of its own.
bool is_ours(const fs::path& folder) {
  std::error_code ignored;
  return fs::exists(folder / "reconstruct.json", ignored) ||
         fs::exists(folder / "cfg_args", ignored);
}

// The files in a folder, and below it where `deep`; sorted. Throws AccessError if a folder cannot be
// listed: a scene of a part of the photos would look whole.
std::vector<fs::path> files_in(const fs::path& folder, bool deep, const fs::path& without = {}) {
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

bool has_photos(const fs::path& folder) {
  const std::vector<fs::path> files = files_in(folder, false);
  return std::any_of(files.begin(), files.end(), [](const fs::path& file) {
    return kPhotoEndings.contains(lowercase_ending(file));
  });
}

// The folder that the photos' names are relative to.
fs::path photo_root(const fs::path& folder) {
  return !has_photos(folder) && has_photos(folder / "images") ? folder / "images" : folder;
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

[[noreturn]] void fail_without_photos(const fs::path& folder, std::size_t unreadable,
                                      std::size_t videos) {
  std::string remedy = "name the folder that holds the photos";
  if (videos)
    remedy = fmt::format(
        "it has {} video(s): name one of them, or the folder that they lie in, for frames of it",
        videos);
  throw Error(fmt::format(
      "cannot find photos in {}: it has no .jpg, .png, .tif or .bmp file{}; {}", folder.string(),
      unreadable ? fmt::format(" that can be read ({} cannot)", unreadable) : "", remedy));
}

struct Header {
  PhotoSize size;
  int orientation = 1;
};

Header read_header(const fs::path& photo) {
  return {read_photo_size(photo), read_photo_orientation(photo)};
}

// A decoder does not say whether a photo is damaged or the system has refused it a moment ago, say
// for lack of descriptors. So what it refuses is tried once more.
Header header_of(const fs::path& photo) {
  try {
    return read_header(photo);
  } catch (const AccessError&) {
    throw;
  } catch (const Error& error) {
    if (error.code() == ExitCode::out_of_memory) throw;
    return read_header(photo);
  }
}

PhotoFile photo_file(const fs::path& file, const std::string& name, PhotoUse use) {
  const Header header = header_of(file);
  PhotoFile photo{file, name, header.size, header.orientation != 1};
  if (!photo.is_copied || use == PhotoUse::in_place) return photo;
  photo.size = upright_size(header.size, header.orientation);
  if (!kCopyEndings.contains(lowercase_ending(file)))
    photo.name = fs::path(name).replace_extension(".png").generic_string();
  return photo;
}

// Files of a user's own scene are not changed.
void leave_as_stored(std::vector<PhotoFile>& photos) {
  std::size_t lying = 0;
  std::string first;
  for (PhotoFile& photo : photos) {
    if (!photo.is_copied) continue;
    if (lying++ == 0) first = photo.name;
    photo.is_copied = false;
  }
  if (lying)
    log_warning(
        "{} not upright (EXIF) and {} so, because the scene's own images/ {}: {}{}; for an upright "
        "scene, reconstruct these photos into another folder (-o)",
        counted(lying, "photo", "is", "are"), lying == 1 ? "stays" : "stay",
        lying == 1 ? "holds it" : "holds them", first, lying > 1 ? ", ..." : "");
}

}  // namespace

std::vector<PhotoFile> find_photos(const fs::path& folder, const fs::path& without, PhotoUse use) {
  if (std::error_code ignored; !fs::is_directory(folder, ignored))
    throw Error(fmt::format("cannot find the photos: there is no folder {}; check the path",
                            folder.string()));
  const fs::path root = photo_root(folder);
  std::vector<PhotoFile> photos;
  std::size_t unreadable = 0, videos = 0;
  for (const fs::path& file : files_in(root, true, without)) {
    if (is_video(file)) ++videos;
    if (!kPhotoEndings.contains(lowercase_ending(file))) continue;
    const std::string name = file.lexically_relative(root).generic_string();
    if (name.starts_with(kMasksFolder)) continue;
    if (printable(name) != name || name.find('\n') != name.npos) {  // COLMAP reads names by lines
      log_warning(
          "a photo is left out, because its name is not UTF-8 or has invisible characters; rename "
          "it: {}",
          printable(name));
      ++unreadable;
      continue;
    }
    try {
      photos.push_back(photo_file(file, name, use));
    } catch (const AccessError&) {  // a scene without it would look whole
      throw;
    } catch (const Error& error) {
      if (error.code() == ExitCode::out_of_memory) throw;
      log_warning("a photo is left out: {}", error.what());
      ++unreadable;
    }
  }
  if (photos.empty()) fail_without_photos(folder, unreadable, videos);
  if (videos)
    log_warning(
        "{} video(s) in {} are not used, as there are photos; name a video for frames of it",
        videos, folder.string());
  if (use == PhotoUse::in_place) leave_as_stored(photos);
  std::sort(photos.begin(), photos.end(),
            [](const PhotoFile& a, const PhotoFile& b) { return a.name < b.name; });
  return photos;
}

std::vector<fs::path> find_videos(const fs::path& source) {
  std::error_code ignored;
  if (fs::is_regular_file(source, ignored) && is_video(source)) return {source};
  if (!fs::is_directory(source, ignored) || has_photos(photo_root(source))) return {};
  std::vector<fs::path> videos = files_in(source, false);
  std::erase_if(videos, [](const fs::path& file) { return !is_video(file); });
  return videos;
}

bool holds_only_photos(const fs::path& folder) {
  check_models_are_visible(folder);
  std::error_code error;
  const bool has_videos = !find_videos(folder).empty();
  if (has_videos && !fs::is_directory(folder, error)) return true;
  if (!has_videos && !has_photos(photo_root(folder))) return false;
  for (const fs::path& file : files_in(folder, false))
    if (is_pose_file(file)) return false;
  if (has_model(folder) || has_model(fs::absolute(folder / "").lexically_normal() / ".."))
    return false;
  for (fs::directory_iterator entry(folder, error), end; !error && entry != end;
       entry.increment(error))
    if (entry->is_directory(error) && has_model(entry->path())) return false;
  return true;
}

}  // namespace gs
