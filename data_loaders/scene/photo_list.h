// SPDX-License-Identifier: Apache-2.0
// dataset.photo_list: the photos of a scene that a run uses.
#pragma once

#include <filesystem>
#include <string>
#include <vector>

namespace gs {

/// Whether each photo is in a list: a text file with a name a line. Names are those of the model;
/// the ending may be left out, and a folder stands for all photos in it. Empty lines and lines that
/// begin with # do not count. Throws Error that names the file and a remedy where it cannot be read
/// or is empty, and for a line that means none of the photos.
std::vector<bool> photos_in_list(const std::filesystem::path& file,
                                 const std::vector<std::string>& names);

/// Writes such a list.
void write_photo_list(const std::filesystem::path& file, const std::vector<std::string>& names);

}  // namespace gs
