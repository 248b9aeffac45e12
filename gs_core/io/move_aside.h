// SPDX-License-Identifier: Apache-2.0
// Nothing that a user has made is ever overwritten: what is in the way is moved or kept aside.
#pragma once

#include <filesystem>

namespace gs {

/// Renames a folder to FOLDER.bak-N, the first N = 1, 2, ... that is free, and returns that path. Throws Error that
/// names both where it cannot.
std::filesystem::path move_aside(const std::filesystem::path& folder);

/// For a file that is about to be replaced by renaming another to its name (AtomicFile): gives it the second name FILE.bak-N, so
/// that FILE is there all the while, older or newer. On a file system without hard links it is moved aside.
std::filesystem::path keep_aside(const std::filesystem::path& file);

}  // namespace gs
