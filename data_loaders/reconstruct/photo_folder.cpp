// SPDX-License-Identifier: Apache-2.0
#include "data_loaders/reconstruct/photo_folder.h"

#include <spdlog/fmt/fmt.h>
#include <unistd.h>

#include <algorithm>
#include <optional>
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

// Of the formats that gemsplat reads, those that every COLMAP reads, too.
const std::set<std::string> kColmapEndings = {".jpg", ".jpeg", ".png", ".bmp", ".tif", ".tiff"};
// Of those, the ones that copies are written in; and formats of photos that get a copy as JPEG,
// because PNGs of them are large and show no more. All others become PNG.
const std::set<std::string> kCopyEndings = {".jpg", ".jpeg", ".png"};
const std::set<std::string> kLossyEndings = {".heic", ".heif", ".avif"};
// Folders of other pictures beside the photos (dataset.masks, dataset.depth).
constexpr const char* kOtherPictures[] = {"masks/", "depth/"};
constexpr std::size_t kMostNamed = 10;  // files in a message

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
  return std::any_of(files.begin(), files.end(),
                     [](const fs::path& file) { return is_picture(file); });
}

std::string joined(const std::vector<std::string>& names) {
  std::string text;
  for (std::size_t i = 0; i < std::min(names.size(), kMostNamed); ++i)
    text += (i ? ", " : "") + names[i];
  if (names.size() > kMostNamed) text += fmt::format(" and {} more", names.size() - kMostNamed);
  return text;
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

// Files that are no photos of the scene.
struct LeftOut {
  std::vector<std::string> foreign;  // photos of formats that gemsplat does not read
  std::size_t unreadable = 0, videos = 0;
  std::string first_fault;  // of the unreadable ones
};

[[noreturn]] void fail_without_photos(const fs::path& folder, const LeftOut& left_out) {
  std::string remedy = "name the folder that holds the photos";
  if (left_out.videos)
    remedy = fmt::format(
        "it has {} video(s): name one of them, or the folder that they lie in, for frames of it",
        left_out.videos);
  if (!left_out.foreign.empty())
    remedy = fmt::format("export {} as JPEG or TIFF, and name the folder of these",
                         joined(left_out.foreign));
  throw Error(fmt::format(
      "cannot find photos in {}: it has no .jpg, .heic, .png, .tif, .webp or other picture{}; {}",
      folder.string(),
      left_out.unreadable ? fmt::format(" that can be read ({} cannot: {})", left_out.unreadable,
                                        left_out.first_fault)
                          : "",
      remedy));
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

// The name of a copy that COLMAP reads.
std::string name_of_copy(const std::string& name) {
  const std::string ending = lowercase_ending(name);
  if (kCopyEndings.contains(ending)) return name;
  return fs::path(name)
      .replace_extension(kLossyEndings.contains(ending) ? ".jpg" : ".png")
      .generic_string();
}

PhotoFile photo_file(const fs::path& file, const std::string& name) {
  const Header header = header_of(file);
  const bool is_known_to_colmap = kColmapEndings.contains(lowercase_ending(file));
  return {file, name, header.size, header.orientation != 1 || !is_known_to_colmap,
          header.orientation};
}

// Gives photos that are copied the name and size of the copy. If another photo has that name, the
// copy keeps its own ending before the new one.
void name_copies(std::vector<PhotoFile>& photos) {
  std::set<std::string> taken;
  for (const PhotoFile& photo : photos)
    if (!photo.is_copied || name_of_copy(photo.name) == photo.name) taken.insert(photo.name);
  for (PhotoFile& photo : photos) {
    if (!photo.is_copied) continue;
    photo.size = upright_size(photo.size, photo.orientation);
    std::string name = name_of_copy(photo.name);
    if (name == photo.name) continue;
    if (taken.contains(name)) name = photo.name + fs::path(name).extension().string();
    photo.name = name;
    taken.insert(name);
  }
}

// Photos in a user's own scene are not changed, and not copied beside themselves.
void leave_as_stored(std::vector<PhotoFile>& photos) {
  std::vector<std::string> lying, unknown;
  for (PhotoFile& photo : photos) {
    if (!photo.is_copied) continue;
    const bool is_known_to_colmap = kColmapEndings.contains(lowercase_ending(photo.path));
    (is_known_to_colmap ? lying : unknown).push_back(photo.name);
    photo.is_copied = !is_known_to_colmap;
  }
  std::erase_if(photos, [](const PhotoFile& photo) { return photo.is_copied; });
  constexpr const char* kRemedy = "reconstruct these photos into another folder (-o)";
  if (!lying.empty())
    log_warning(
        "{} not upright (EXIF), and the scene's own images/ are not changed; for an upright "
        "scene, {}: {}",
        counted(lying.size(), "photo", "is", "are"), kRemedy, joined(lying));
  if (!unknown.empty())
    log_warning(
        "{} left out, because COLMAP does not read the format and the scene's own images/ "
        "are not changed; {}: {}",
        counted(unknown.size(), "photo", "is", "are"), kRemedy, joined(unknown));
}

bool is_beside_photos(const std::string& name) {
  return std::ranges::any_of(kOtherPictures,
                             [&](const char* folder) { return name.starts_with(folder); });
}

// The photo; none, and a warning, where it cannot be used.
std::optional<PhotoFile> usable_photo(const fs::path& file, const std::string& name,
                                      LeftOut& left_out) {
  std::string fault;
  if (printable(name) != name || name.find('\n') != name.npos) {  // COLMAP reads names by lines
    fault = fmt::format("its name is not UTF-8 or has invisible characters, so rename it: {}",
                        printable(name));
  } else {
    try {
      return photo_file(file, name);
    } catch (const AccessError&) {  // a scene without it would look whole
      throw;
    } catch (const Error& error) {
      if (error.code() == ExitCode::out_of_memory) throw;
      fault = error.what();
      if (!kColmapEndings.contains(lowercase_ending(file))) fault += ", or convert it to JPEG";
    }
  }
  log_warning("a photo is left out: {}", fault);
  if (left_out.unreadable++ == 0) left_out.first_fault = fault;
  return {};
}

}  // namespace

std::vector<PhotoFile> find_photos(const fs::path& folder, const fs::path& without, PhotoUse use) {
  if (std::error_code ignored; !fs::is_directory(folder, ignored))
    throw Error(fmt::format("cannot find the photos: there is no folder {}; check the path",
                            folder.string()));
  const fs::path root = photo_root(folder);
  std::vector<PhotoFile> photos;
  LeftOut left_out;
  for (const fs::path& file : files_in(root, true, without)) {
    const std::string name = file.lexically_relative(root).generic_string();
    if (is_beside_photos(name)) continue;
    left_out.videos += is_video(file);
    if (is_foreign_photo(file)) left_out.foreign.push_back(printable(name));
    if (!is_picture(file)) continue;
    if (auto photo = usable_photo(file, name, left_out)) photos.push_back(std::move(*photo));
  }
  if (use == PhotoUse::in_place) leave_as_stored(photos);
  if (photos.empty()) fail_without_photos(folder, left_out);
  if (left_out.videos)
    log_warning(
        "{} video(s) in {} are not used, as there are photos; name a video for frames of it",
        left_out.videos, folder.string());
  if (!left_out.foreign.empty())
    log_warning(
        "{} left out, because gemsplat does not read the format; export them as JPEG or "
        "TIFF first: {}",
        counted(left_out.foreign.size(), "photo", "is", "are"), joined(left_out.foreign));
  name_copies(photos);
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
