// SPDX-License-Identifier: Apache-2.0
#include "data_loaders/transforms/transforms_file.h"

#include <algorithm>
#include <utility>

#include "data_loaders/photos/photo_names.h"
#include "gs_core/system/byte_reader.h"
#include "gs_core/system/files/access.h"
#include "gs_core/system/text/json.h"
#include "gs_core/system/text/read_json.h"

namespace gs {
namespace {

namespace fs = std::filesystem;

}  // namespace

void TransformsFile::fail(const std::string& what) const { cannot_read(path, what); }

TransformsFile open_transforms_file(const fs::path& path) {
  TransformsFile file{path, read_json_as<SortedJson>(path, "write it again")};
  const auto frames = file.top.is_object() ? file.top.find("frames") : file.top.end();
  if (!file.top.is_object() || frames == file.top.end() || !frames->is_array() || frames->empty())
    file.fail(
        "it has no list \"frames\" with a frame in it; name a file that nerfstudio, instant-ngp or "
        "Blender wrote");
  return file;
}

std::optional<std::string> path_inside(const fs::path& folder, std::string name) {
  name = name_below(folder, std::move(name));
  std::replace(name.begin(), name.end(), '\\', '/');
  const bool has_drive = name.size() > 2 && name[1] == ':' && name[2] == '/';
  if (name.empty() || name.find('\0') != name.npos || has_drive) return std::nullopt;
  const fs::path path = fs::path(name).lexically_normal();
  const fs::path last = path.filename();
  if (path.is_absolute() || *path.begin() == ".." || last.empty() || last == ".")
    return std::nullopt;
  return path.generic_string();
}

std::string with_extension(const fs::path& folder, const std::string& name) {
  if (is_file(folder / name)) return name;
  for (const char* extension : {".png", ".jpg", ".jpeg"})
    if (is_file(folder / (name + extension))) return name + extension;
  return name;
}

}  // namespace gs
