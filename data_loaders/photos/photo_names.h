// SPDX-License-Identifier: Apache-2.0
// Which files of a folder are pictures, by their names.
#pragma once

#include <filesystem>
#include <string>
#include <vector>

namespace gs {

/// Whether gemsplat reads files of this extension as pictures. A build without OpenImageIO reads JPEG
/// and PNG only.
bool is_picture(const std::filesystem::path& file);

/// Whether this is the extension of a photo that gemsplat does not read, such as .dng.
bool is_foreign_photo(const std::filesystem::path& file);

/// The extension with its dot, in lower case; empty if there is none.
std::string lowercase_ending(const std::filesystem::path& file);

/// The name that a model written on Windows means, for use below `folder`: back-slashes are slashes,
/// and of a path with a drive ("C:/scene/images/a.jpg") the longest end is taken that is a file below
/// the folder. A name that is a file there stays, and so does a path of which no end is one.
std::string name_below(const std::filesystem::path& folder, std::string name);

/// The name of a picture without its extension, as cameras.json has it. Only extensions of pictures
/// count, in upper or lower case: "a/b.JPG" is "a/b", and "frame.7" has no extension.
std::string without_extension(const std::string& name);

/// The pictures in a folder and below it, by their extension, as sorted paths relative to it with
/// "/" between folders. Hidden files and folders are skipped. A folder that is not there is empty.
/// Throws AccessError for one that cannot be read; folders below it that nobody may read are skipped.
std::vector<std::string> picture_names_in(const std::filesystem::path& folder);

}  // namespace gs
