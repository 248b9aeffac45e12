// SPDX-License-Identifier: Apache-2.0
#include "gs_core/system/files/move_aside.h"

#include <fcntl.h>
#include <spdlog/fmt/fmt.h>
#include <stdio.h>

#include <cerrno>
#include <functional>

#include "gs_core/error.h"
#include "gs_core/system/files/access.h"

namespace gs {

namespace fs = std::filesystem;

namespace {

constexpr int kMostBackups = 1'000'000;

fs::path without_slash(const fs::path& path) {  // "runs/a/"
  const fs::path whole = fs::absolute(path).lexically_normal();
  return whole.has_filename() ? whole : whole.parent_path();
}

// Calls make(FROM.bak-N) for N = 1, 2, ... until it does not say that the name is taken.
fs::path with_free_name(const fs::path& from,
                        const std::function<std::error_code(const fs::path&)>& make,
                        std::error_code& error) {
  for (int n = 1; n < kMostBackups; ++n) {
    const fs::path backup = from.string() + fmt::format(".bak-{}", n);
    if (is_there(backup)) continue;
    error = make(backup);
    if (error != std::errc::file_exists) return backup;  // else another process was faster
  }
  return from.string() + ".bak-N";
}

std::string cannot_move(const fs::path& folder, const std::string& why) {
  return fmt::format("cannot move {} away: {}; choose another output with -o", folder.string(),
                     why);
}

}  // namespace

bool is_within(const fs::path& inner, const fs::path& outer) {
  const fs::path relative = fs::weakly_canonical(without_slash(inner))
                                .lexically_relative(fs::weakly_canonical(without_slash(outer)));
  return !relative.empty() && *relative.begin() != "..";
}

void check_may_move(const fs::path& folder, const std::vector<fs::path>& needed) {
  for (const fs::path& path : needed)
    if (!path.empty() && is_within(path, folder))
      throw UsageError(
          cannot_move(folder, path.string() + ", which this command reads, lies in it"));
  std::error_code error;
  const fs::path here = fs::current_path(error);
  if (!error && is_within(here, folder))
    throw UsageError(cannot_move(folder, "it holds the current folder"));
}

std::error_code rename_to_new(const fs::path& from, const fs::path& to) {
#ifdef RENAME_NOREPLACE
  if (::renameat2(AT_FDCWD, from.c_str(), AT_FDCWD, to.c_str(), RENAME_NOREPLACE) == 0) return {};
  if (errno != EINVAL && errno != ENOSYS) return {errno, std::generic_category()};
#endif
  if (is_there(to)) return std::make_error_code(std::errc::file_exists);
  std::error_code error;  // a file system that cannot do it in one step
  fs::rename(from, to, error);
  return error;
}

fs::path keep_aside(const fs::path& file) {
  // The target of a symbolic link gets the second name, since AtomicFile replaces the target.
  const fs::path target = fs::canonical(file);
  std::error_code error;
  const auto link = [&](const fs::path& backup) {
    std::error_code no_link;
    fs::create_hard_link(target, backup, no_link);
    return no_link;
  };
  const fs::path backup = with_free_name(fs::absolute(file).lexically_normal(), link, error);
  return error ? move_aside(file) : backup;  // a file system without hard links
}

fs::path move_aside(const fs::path& folder) {
  const fs::path from = without_slash(folder);
  std::error_code error;
  const fs::path backup = with_free_name(
      from, [&](const fs::path& to) { return rename_to_new(from, to); }, error);
  if (error)
    throw Error(fmt::format("cannot move {} to {}: {}; choose another place", from.string(),
                            backup.string(), error.message()));
  return backup;
}

}  // namespace gs
