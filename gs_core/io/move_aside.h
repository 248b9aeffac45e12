// SPDX-License-Identifier: Apache-2.0
// Keeps files and folders that are in the way under another name, so that nothing of a user's is
// ever overwritten.
#pragma once

#include <filesystem>

namespace gs {

/// Renames a folder to FOLDER.bak-N, with the first N = 1, 2, ... that is free, and returns that
/// path. Throws Error, which names both paths, if it cannot.
std::filesystem::path move_aside(const std::filesystem::path& folder);

/// Gives a file that AtomicFile is about to replace the second name FILE.bak-N, and returns that
/// path. FILE exists all the while, first the older and then the newer one. On a file system
/// without hard links the file is moved aside.
std::filesystem::path keep_aside(const std::filesystem::path& file);

}  // namespace gs
