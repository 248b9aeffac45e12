// SPDX-License-Identifier: Apache-2.0
// One parsed transforms.json, and the file names in it; used by transforms/*.cpp only.
#pragma once

#include <filesystem>
#include <optional>
#include <string>

#include "gs_core/system/text/json.h"

namespace gs {

/// An object with a list "frames" that is not empty.
struct TransformsFile {
  std::filesystem::path path;
  SortedJson top;

  std::filesystem::path folder() const { return path.parent_path(); }
  const SortedJson& frames() const { return *top.find("frames"); }
  /// Throws Error: cannot read FILE: `what`.
  [[noreturn]] void fail(const std::string& what) const;
};

/// Reads and parses a file. Throws Error for anything else than an object with frames.
TransformsFile open_transforms_file(const std::filesystem::path& path);

/// A path relative to the folder of the file that names it, with "/" between folders and without
/// "./"; of a path of Windows, what name_below() takes of it. Nothing if the path is absolute, leads
/// out of the folder or cannot be that of a file.
std::optional<std::string> path_inside(const std::filesystem::path& folder, std::string name);

/// The name of a file that exists, with the extension .png, .jpg or .jpeg added where the file
/// leaves it out, as Blender's do. The name itself if there is no such file.
std::string with_extension(const std::filesystem::path& folder, const std::string& name);

}  // namespace gs
