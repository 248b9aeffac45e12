// SPDX-License-Identifier: Apache-2.0
#include "gs_app/run/output_place.h"

#include <algorithm>

#include "gs_core/system/log.h"
#include "gs_model/formats/formats.h"

namespace gs {
namespace {

namespace fs = std::filesystem;

// "table" of table.compressed.ply.
std::string name_without_ending(const fs::path& file) {
  const std::string name = file.filename().string();
  const ModelFormat* const format = find_format(file);
  const bool has_more = format && name.size() > format->ending.size();
  return has_more ? name.substr(0, name.size() - format->ending.size()) : file.stem().string();
}

bool is_free(const fs::path& place) {
  return fs::symlink_status(place).type() == fs::file_type::not_found;
}

}  // namespace

fs::path beside(const fs::path& input, const std::string& suffix) {
  fs::path path = fs::absolute(input).lexically_normal();
  if (!path.has_filename()) path = path.parent_path();  // "scene/"
  std::error_code ignored;
  const bool is_folder = fs::is_directory(path, ignored);
  const std::string name = is_folder ? path.filename().string() : name_without_ending(path);
  const fs::path place = path.parent_path() / (name + suffix);
  return input.is_absolute() ? place : place.lexically_proximate(fs::current_path());
}

void say_place(const fs::path& place) {
  log_info("writing to {}; -o names another place", place.string());
}

fs::path new_place(const fs::path& stem, const std::vector<std::string>& endings) {
  for (int number = 1;; ++number) {
    const std::string name = stem.string() + (number == 1 ? "" : "-" + std::to_string(number));
    if (!std::all_of(endings.begin(), endings.end(),
                     [&](const std::string& ending) { return is_free(name + ending); }))
      continue;
    say_place(name + endings.front());
    return name + endings.front();
  }
}

}  // namespace gs
