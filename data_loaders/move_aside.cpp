// SPDX-License-Identifier: Apache-2.0
#include "data_loaders/move_aside.h"

#include <spdlog/fmt/fmt.h>

#include "gs_core/error.h"

namespace gs {

namespace fs = std::filesystem;

fs::path move_aside(const fs::path& folder) {
  fs::path from = fs::absolute(folder).lexically_normal();
  if (!from.has_filename()) from = from.parent_path();  // "runs/a/"
  fs::path backup;
  for (int n = 1; backup.empty() || fs::exists(backup); ++n)
    backup = from.string() + fmt::format(".bak-{}", n);
  std::error_code error;
  fs::rename(from, backup, error);
  if (error)
    throw Error(fmt::format("cannot move {} to {}: {}; choose another place", from.string(),
                            backup.string(), error.message()));
  return backup;
}

}  // namespace gs
