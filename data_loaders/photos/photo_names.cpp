// SPDX-License-Identifier: Apache-2.0
#include "data_loaders/photos/photo_names.h"

#include <spdlog/fmt/fmt.h>

#include <algorithm>
#include <array>
#include <set>
#include <string_view>
#include <unordered_map>
#include <unordered_set>

#include "gs_core/error.h"
#include "gs_core/log.h"

namespace gs {
namespace {

namespace fs = std::filesystem;

constexpr std::array<std::string_view, 17> kPictureExtensions = {
    ".jpg", ".jpeg", ".png", ".tif", ".tiff", ".bmp", ".webp", ".exr", ".hdr",
    ".tga", ".gif",  ".ppm", ".pgm", ".pnm",  ".jp2", ".heic", ".avif"};
// Of photos that cannot be read here, but that a model may name: they are converted before training.
constexpr std::array<std::string_view, 11> kRawExtensions = {
    ".dng", ".cr2", ".cr3", ".nef", ".arw", ".orf", ".raf", ".rw2", ".raw", ".heif", ".jxl"};

/// ASCII letters only, as case is told apart in other letters by rules that files do not share.
std::string lower(std::string text) {
  for (char& c : text)
    if (c >= 'A' && c <= 'Z') c = char(c - 'A' + 'a');
  return text;
}
std::string lower_without_extension(const std::string& name) {
  return lower(without_extension(name));
}

/// What two names must share to be taken for the same photo, the closest likeness first.
struct Likeness {
  std::string (*key)(const std::string& name);
  const char* difference;
};
constexpr Likeness kLikenesses[] = {
    {[](const std::string& name) { return lower(name); }, "upper and lower case"},
    {without_extension, "extension"},
    {lower_without_extension, "case and extension"}};

bool is_picture(const fs::path& path) {
  return std::find(kPictureExtensions.begin(), kPictureExtensions.end(), lowercase_ending(path)) !=
         kPictureExtensions.end();
}

/// The names that share each key; those that have none to themselves are ambiguous.
std::unordered_map<std::string, std::vector<std::string>> by_key(const std::set<std::string>& names,
                                                                 const Likeness& likeness) {
  std::unordered_map<std::string, std::vector<std::string>> result;
  for (const std::string& name : names) result[likeness.key(name)].push_back(name);
  return result;
}

/// Takes the pairs of a missing name and a file that are alike, each the only one of its kind, out of
/// both sets, and returns the file of each name.
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
    log_warning("{} photos are taken for names in the model that differ in {}: {} for '{}'{}",
                pairs.size(), likeness.difference, first->second, first->first,
                pairs.size() > 1 ? ", ..." : "");
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
                     : fmt::format(
                           " ({} photos there are not in the model, or could be more than "
                           "one of it: {}{})",
                           unused.size(), unused.front(), unused.size() > 1 ? ", ..." : "");
  throw Error(fmt::format(
      "{} of the model's {} photos are not in {}: {}{}; copy them there or name another folder "
      "with --set dataset.images=FOLDER",
      missing.size(), name_count, folder.string(), list, others));
}

}  // namespace

std::string lowercase_ending(const fs::path& file) { return lower(file.extension().string()); }

std::string without_extension(const std::string& name) {
  const std::string ending = lowercase_ending(name);
  const bool is_raw =
      std::find(kRawExtensions.begin(), kRawExtensions.end(), ending) != kRawExtensions.end();
  return is_picture(name) || is_raw ? fs::path(name).replace_extension().generic_string() : name;
}

std::vector<std::string> picture_names_in(const fs::path& folder) {
  std::vector<std::string> names;
  std::error_code error;
  fs::recursive_directory_iterator entry(folder, fs::directory_options::skip_permission_denied,
                                         error);
  for (const fs::recursive_directory_iterator end; !error && entry != end; entry.increment(error)) {
    std::error_code ignored;
    if (entry->path().filename().native().front() == '.')
      entry.disable_recursion_pending();
    else if (is_picture(entry->path()) && entry->is_regular_file(ignored))
      names.push_back(entry->path().lexically_relative(folder).generic_string());
  }
  std::sort(names.begin(), names.end());
  return names;
}

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

std::vector<fs::path> find_photos(const std::vector<std::string>& names, const fs::path& folder) {
  std::vector<fs::path> paths = match_photos(names, folder);
  std::set<std::string> missing;
  for (std::size_t i = 0; i < names.size(); ++i)
    if (paths[i].empty()) missing.insert(names[i]);
  if (missing.empty()) return paths;
  fail_missing(missing, names.size(), pictures_besides(paths, folder), folder);
}

}  // namespace gs
