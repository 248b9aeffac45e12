// SPDX-License-Identifier: Apache-2.0
// From the image names of a model to the files of their photos. Photos are often converted or
// renamed after COLMAP has seen them, so names are not always the files' own.
#pragma once

#include <filesystem>
#include <string>
#include <vector>

namespace gs {

/// The extension with its dot, in lower case; empty where there is none.
std::string lowercase_ending(const std::filesystem::path& file);

/// The name of a picture without its extension, as cameras.json has it. Only extensions of pictures
/// count, in upper or lower case: "a/b.JPG" is "a/b", and "frame.7" has no extension.
std::string without_extension(const std::string& name);

/// The files below a folder that are pictures by their extension, as paths relative to it with "/"
/// between folders, sorted. Hidden files and folders are passed over; a folder that cannot be read
/// has none.
std::vector<std::string> picture_names_in(const std::filesystem::path& folder);

/// The file of each image name, empty where there is none. A name leads to the file of that name;
/// where there is none, to the one picture that differs only in upper and lower case, or else in
/// its extension, or else in both, if it belongs to no other name. The folder is part of the name:
/// photos of one name in two sub-folders are two photos. Warns with a count where names differ.
std::vector<std::filesystem::path> match_photos(const std::vector<std::string>& names,
                                                const std::filesystem::path& folder);

/// The pictures below a folder that are none of `files`, which are empty or begin with the folder;
/// sorted, and relative to it.
std::vector<std::string> pictures_besides(const std::vector<std::filesystem::path>& files,
                                          const std::filesystem::path& folder);

/// match_photos(); throws Error that names the photos that are missing.
std::vector<std::filesystem::path> find_photos(const std::vector<std::string>& names,
                                               const std::filesystem::path& folder);

}  // namespace gs
