// SPDX-License-Identifier: Apache-2.0
#include "gs_core/io/move_aside.h"

#include <spdlog/fmt/fmt.h>

#include "gs_core/error.h"

namespace gs {

namespace fs = std::filesystem;

namespace {

fs::path without_slash(const fs::path& path) {  // "runs/a/"
  const fs::path whole = fs::absolute(path).lexically_normal();
  return whole.has_filename() ? whole : whole.parent_path();
}

fs::path free_backup(const fs::path& from) {
  fs::path backup;
  for (int n = 1; backup.empty() || fs::exists(backup); ++n)
    backup = from.string() + fmt::format(".bak-{}", n);
  return backup;
}

}  // namespace

fs::path keep_aside(const fs::path& file) {
  const fs::path backup = free_backup(fs::absolute(file).lexically_normal());
  std::error_code no_links;
  // The target of a symbolic link gets the second name, since AtomicFile replaces the target.
  fs::create_hard_link(fs::canonical(file), backup, no_links);
  return no_links ? move_aside(file) : backup;
}

fs::path move_aside(const fs::path& folder) {
  const fs::path from = without_slash(folder), backup = free_backup(from);
  std::error_code error;
  fs::rename(from, backup, error);
  if (error)
    throw Error(fmt::format("cannot move {} to {}: {}; choose another place", from.string(),
                            backup.string(), error.message()));
  return backup;
}

}  // namespace gs
