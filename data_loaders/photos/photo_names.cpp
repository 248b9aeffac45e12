// SPDX-License-Identifier: Apache-2.0
#include "data_loaders/photos/photo_names.h"

#include <algorithm>
#include <array>
#include <string_view>
#include <utility>

#include "gs_core/system/files/access.h"
#include "gs_core/system/text/ascii.h"

namespace gs {
namespace {

namespace fs = std::filesystem;

constexpr std::array<std::string_view, 18> kPictureExtensions = {
    ".jpg", ".jpeg", ".png", ".tif", ".tiff", ".bmp", ".webp", ".exr",  ".hdr",
    ".tga", ".gif",  ".ppm", ".pgm", ".pnm",  ".jp2", ".heic", ".heif", ".avif"};

// Extensions of raw photos and the like. They cannot be read here, but a model may name them if they
// were converted before training.
constexpr std::array<std::string_view, 10> kForeignExtensions = {
    ".dng", ".cr2", ".cr3", ".nef", ".arw", ".orf", ".raf", ".rw2", ".raw", ".jxl"};

template <std::size_t N>
bool has_one_of(const std::array<std::string_view, N>& extensions, const fs::path& file) {
  return std::find(extensions.begin(), extensions.end(), lowercase_ending(file)) !=
         extensions.end();
}

}  // namespace

bool is_picture(const fs::path& file) { return has_one_of(kPictureExtensions, file); }

bool is_foreign_photo(const fs::path& file) { return has_one_of(kForeignExtensions, file); }

std::string lowercase_ending(const fs::path& file) { return lowercase(file.extension().string()); }

std::string name_below(const fs::path& folder, std::string name) {
  const auto is_file = [&](const std::string& below) {
    std::error_code ignored;
    return fs::is_regular_file(folder / below, ignored);
  };
  const bool has_drive = name.size() > 2 && name[1] == ':' && (name[2] == '/' || name[2] == '\\');
  const bool may_be_of_windows = has_drive || name.find('\\') != name.npos;
  if (!may_be_of_windows || name.find('\0') != name.npos || is_file(name)) return name;
  std::replace(name.begin(), name.end(), '\\', '/');
  if (!has_drive) return name;
  for (std::size_t at = name.find('/'); at != name.npos; at = name.find('/', at + 1))
    if (const std::string end = name.substr(at + 1); !end.empty() && is_file(end)) return end;
  return name;
}

std::string without_extension(const std::string& name) {
  return is_picture(name) || is_foreign_photo(name)
             ? fs::path(name).replace_extension().generic_string()
             : name;
}

std::vector<std::string> picture_names_in(const fs::path& folder) {
  std::vector<std::string> names;
  std::vector<fs::path> folders = {folder};
  while (!folders.empty()) {
    const fs::path current = std::move(folders.back());
    folders.pop_back();
    std::error_code error;
    fs::directory_iterator entry(current, error);
    for (const fs::directory_iterator end; !error && entry != end; entry.increment(error)) {
      std::error_code ignored;
      if (entry->path().filename().native().front() == '.') continue;
      if (entry->is_directory(ignored) && !entry->is_symlink(ignored))
        folders.push_back(entry->path());
      else if (is_picture(entry->path()) && entry->is_regular_file(ignored))
        names.push_back(entry->path().lexically_relative(folder).generic_string());
    }
    if (error == std::errc::no_such_file_or_directory || error == std::errc::not_a_directory)
      continue;
    if (error == std::errc::permission_denied) {
      if (current != folder) continue;  // a folder of others, such as lost+found
      cannot_access(folder, error.message() + "; check its permissions");
    }
    if (error) cannot_access(current, error.message() + "; check the disk");
  }
  std::sort(names.begin(), names.end());
  return names;
}

}  // namespace gs
