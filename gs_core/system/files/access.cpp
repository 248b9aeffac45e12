// SPDX-License-Identifier: Apache-2.0
#include "gs_core/system/files/access.h"

#include <spdlog/fmt/fmt.h>

#include <algorithm>

namespace gs {

namespace fs = std::filesystem;

void cannot_access(const fs::path& path, const std::string& what) {
  throw AccessError(fmt::format("cannot read {}: {}", path.string(), what));
}

std::vector<fs::path> entries_of(const fs::path& folder) {
  std::vector<fs::path> entries;
  std::error_code error;
  for (fs::directory_iterator entry(folder, error), end; !error && entry != end;
       entry.increment(error))
    entries.push_back(entry->path());
  if (error && error != std::errc::no_such_file_or_directory && error != std::errc::not_a_directory)
    cannot_access(folder, error.message() + "; check its permissions and the disk");
  std::sort(entries.begin(), entries.end());
  return entries;
}

bool is_file(const fs::path& path) {
  std::error_code ignored;
  return fs::is_regular_file(path, ignored);
}

bool is_folder(const fs::path& path) {
  std::error_code ignored;
  return fs::is_directory(path, ignored);
}

bool is_there(const fs::path& path) {
  std::error_code ignored;
  return fs::symlink_status(path, ignored).type() != fs::file_type::not_found;
}

}  // namespace gs
