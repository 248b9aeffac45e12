// SPDX-License-Identifier: Apache-2.0
// Small pictures of photos, made once and kept in the project's .thumbs/.
#pragma once

#include <filesystem>
#include <string>

namespace gs {

/// The file of a photo's small picture, upright, a JPEG. Throws Error where there is no such photo
/// or it cannot be read. One is made at a time.
std::filesystem::path thumbnail_of(const std::filesystem::path& project,
                                   const std::filesystem::path& photos, const std::string& name);

}  // namespace gs
