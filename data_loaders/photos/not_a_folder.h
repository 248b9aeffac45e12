// SPDX-License-Identifier: Apache-2.0
// The end of a message where a folder of photos or of a scene is wanted, and there is none.
#pragma once

#include <filesystem>
#include <string>

namespace gs {

/// What is at `path`, which is no folder, and what to do: "fox.zip is an archive: unpack it first
/// ...", or "there is no such folder; check the path".
std::string remedy_of_no_folder(const std::filesystem::path& path);

/// Whether this is the extension of an archive, which may hold photos.
bool is_archive(const std::filesystem::path& file);

}  // namespace gs
