// SPDX-License-Identifier: Apache-2.0
// Keeps files and folders that are in the way under another name, so that nothing of a user's is
// ever overwritten.
#pragma once

#include <filesystem>
#include <system_error>
#include <vector>

namespace gs {

/// Whether a path is a folder or lies in it. Symbolic links are followed, and neither need exist.
bool is_within(const std::filesystem::path& inner, const std::filesystem::path& outer);

/// Throws UsageError if a folder may not be moved aside, because a path of `needed` or the current
/// folder lies in it. An empty path of `needed` means none.
void check_may_move(const std::filesystem::path& folder,
                    const std::vector<std::filesystem::path>& needed);

/// Renames a file or a folder to FOLDER.bak-N, with the first N = 1, 2, ... that is free, and
/// returns that path. Throws Error, which names both paths, if it cannot.
std::filesystem::path move_aside(const std::filesystem::path& folder);

/// Renames a file or folder, and never replaces what has the new name already: the error is then
/// EEXIST.
std::error_code rename_to_new(const std::filesystem::path& from, const std::filesystem::path& to);

/// Gives a file that AtomicFile is about to replace the second name FILE.bak-N, and returns that
/// path. FILE exists all the while, first the older and then the newer one. On a file system
/// without hard links the file is moved aside.
std::filesystem::path keep_aside(const std::filesystem::path& file);

}  // namespace gs
