// SPDX-License-Identifier: Apache-2.0
// Nothing that a user has made is ever overwritten: what is in the way is moved aside.
#pragma once

#include <filesystem>

namespace gs {

/// Renames a folder to FOLDER.bak-N, the first N = 1, 2, ... that is free, and returns that path. Throws Error that
/// names both where it cannot.
std::filesystem::path move_aside(const std::filesystem::path& folder);

}  // namespace gs
