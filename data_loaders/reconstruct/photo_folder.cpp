// SPDX-License-Identifier: Apache-2.0
#include "data_loaders/reconstruct/photo_folder.h"

#include <spdlog/fmt/fmt.h>

#include <algorithm>
#include <fstream>
#include <iterator>
#include <map>
#include <optional>
#include <set>

#include "data_loaders/counted.h"
#include "data_loaders/photos/cut_short.h"
#include "data_loaders/photos/not_a_folder.h"
#include "data_loaders/photos/orientation.h"
#include "data_loaders/photos/panorama.h"
#include "data_loaders/photos/photo_names.h"
#include "data_loaders/reconstruct/photo_walk.h"
#include "data_loaders/video/film_frames.h"
#include "gs_core/error.h"
#include "gs_core/system/files/access.h"
#include "gs_core/system/log.h"

namespace gs {
namespace {

namespace fs = std::filesystem;

// Of the formats that gemsplat reads, those that every COLMAP reads, too.
const std::set<std::string> kColmapEndings = {".jpg", ".jpeg", ".png", ".bmp", ".tif", ".tiff"};
// Of those, the ones that copies are written in; and formats of photos that get a copy as JPEG,
// because PNGs of them are large and show no more. All others become PNG.
const std::set<std::string> kCopyEndings = {".jpg", ".jpeg", ".png"};
const std::set<std::string> kLossyEndings = {".heic", ".heif", ".avif"};
constexpr std::size_t kMostNamed = 10;  // files in a message

std::string joined(const std::vector<std::string>& names) {
  std::string text;
  for (std::size_t i = 0; i < std::min(names.size(), kMostNamed); ++i)
    text += (i ? ", " : "") + names[i];
  if (names.size() > kMostNamed) text += fmt::format(" and {} more", names.size() - kMostNamed);
  return text;
}

// Files that are no photos of the scene.
struct LeftOut {
  std::vector<std::string> videos, archives;
  std::vector<std::string> foreign;  // photos of formats that gemsplat does not read
  std::size_t unreadable = 0;
  std::string first_fault;  // of the unreadable ones
};

[[noreturn]] void fail_without_photos(const fs::path& folder, const LeftOut& left_out) {
  std::string remedy = "name the folder that holds the photos";
  if (!left_out.videos.empty())
    remedy = fmt::format(
        "it has {} video(s): name one of them, or the folder that they lie in, for frames of it",
        left_out.videos.size());
  if (!left_out.archives.empty()) remedy = fmt::format("unpack {}", joined(left_out.archives));
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

// Throws Error for photos that COLMAP would take for something else.
PhotoFile photo_file(const fs::path& file, const std::string& name) {
  if (is_cut_short(file)) throw Error(fmt::format("{} is cut short; copy it again", file.string()));
  const Header header = header_of(file);
  const bool is_known_to_colmap = kColmapEndings.contains(lowercase_ending(file));
  return {file,
          name,
          header.size,
          header.orientation != 1 || !is_known_to_colmap,
          header.orientation,
          is_panorama(file, header.size)};
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

// COLMAP places panoramas by their views, and ordinary photos as they are, but not both at once.
void leave_out_panoramas(std::vector<PhotoFile>& photos) {
  std::vector<std::string> panoramas;
  for (const PhotoFile& photo : photos)
    if (photo.is_panorama) panoramas.push_back(photo.name);
  if (panoramas.empty() || panoramas.size() == photos.size()) return;
  std::erase_if(photos, &PhotoFile::is_panorama);
  log_warning(
      "{} left out, because there are ordinary photos; put panoramas of 360 degrees into a folder "
      "of "
      "their own and reconstruct that: {}",
      counted(panoramas.size(), "panorama", "is", "are"), joined(panoramas));
}

bool have_same_bytes(const fs::path& a, const fs::path& b) {
  std::ifstream first(a, std::ios::binary), second(b, std::ios::binary);
  using Bytes = std::istreambuf_iterator<char>;
  return std::equal(Bytes(first), Bytes(), Bytes(second), Bytes());
}

// A copy of a photo counts twice in training, and may be held out while its twin trains.
void warn_of_copies(const std::vector<PhotoFile>& photos) {
  std::map<std::uintmax_t, std::vector<const PhotoFile*>> by_size;
  std::vector<std::string> copies;
  for (const PhotoFile& photo : photos) {
    std::error_code none;
    std::vector<const PhotoFile*>& others = by_size[fs::file_size(photo.path, none)];
    const auto twin = std::find_if(others.begin(), others.end(), [&](const PhotoFile* other) {
      return have_same_bytes(photo.path, other->path);
    });
    if (twin == others.end())
      others.push_back(&photo);
    else
      copies.push_back(fmt::format("{} ({})", photo.name, (*twin)->name));
  }
  if (!copies.empty())
    log_warning("{} the same as another one; take one of the two away: {}",
                counted(copies.size(), "photo", "is", "are"), joined(copies));
}

}  // namespace

std::vector<PhotoFile> find_photos(const fs::path& folder, const fs::path& without, PhotoUse use) {
  if (std::error_code ignored; !fs::is_directory(folder, ignored))
    throw Error(
        fmt::format("cannot find photos in {}: {}", folder.string(), remedy_of_no_folder(folder)));
  const fs::path root = photo_root(folder);
  std::vector<PhotoFile> photos;
  LeftOut left_out;
  for (const fs::path& file : files_in(root, true, without)) {
    const std::string name = file.lexically_relative(root).generic_string();
    if (is_video(file)) left_out.videos.push_back(printable(name));
    if (is_archive(file)) left_out.archives.push_back(printable(name));
    if (is_foreign_photo(file)) left_out.foreign.push_back(printable(name));
    if (!is_scene_photo(file, root)) continue;
    if (auto photo = usable_photo(file, name, left_out)) photos.push_back(std::move(*photo));
  }
  leave_out_panoramas(photos);
  if (use == PhotoUse::in_place) leave_as_stored(photos);
  if (photos.empty()) fail_without_photos(folder, left_out);
  if (!left_out.videos.empty())
    log_warning("{} not used, as there are photos; name a video for frames of it: {}",
                counted(left_out.videos.size(), "video", "is", "are"), joined(left_out.videos));
  if (!left_out.archives.empty())
    log_warning("{} not opened; unpack what belongs to the scene: {}",
                counted(left_out.archives.size(), "archive", "is", "are"),
                joined(left_out.archives));
  if (!left_out.foreign.empty())
    log_warning(
        "{} left out, because gemsplat does not read the format; export them as JPEG or "
        "TIFF first: {}",
        counted(left_out.foreign.size(), "photo", "is", "are"), joined(left_out.foreign));
  name_copies(photos);
  std::sort(photos.begin(), photos.end(),
            [](const PhotoFile& a, const PhotoFile& b) { return a.name < b.name; });
  warn_of_copies(photos);
  return photos;
}

}  // namespace gs
