// SPDX-License-Identifier: Apache-2.0
#include "data_loaders/photos/not_a_folder.h"

#include <spdlog/fmt/fmt.h>

#include <algorithm>
#include <set>

#include "data_loaders/photos/photo_names.h"

namespace gs {
namespace {

namespace fs = std::filesystem;

using Endings = std::set<std::string>;
const Endings kArchives = {".zip", ".7z", ".rar", ".tar", ".gz", ".tgz", ".xz", ".zst"};
const Endings kModels = {".ply",  ".spz", ".sog",  ".splat", ".ksplat", ".rad",
                         ".gs4d", ".glb", ".usda", ".usdc",  ".usdz"};
const Endings kCameras = {".xml", ".json", ".bin", ".txt", ".csv", ".out", ".db", ".psx"};

}  // namespace

bool is_archive(const fs::path& file) { return kArchives.contains(lowercase_ending(file)); }

std::string remedy_of_no_folder(const fs::path& path) {
  std::error_code ignored;
  if (!fs::exists(path, ignored)) return "there is no such folder; check the path";
  const std::string name = path.filename().string(), ending = lowercase_ending(path);
  if (is_archive(path))
    return fmt::format("{} is an archive: unpack it first, and name the folder that it gives",
                       name);
  if (is_picture(path) || is_foreign_photo(path))
    return fmt::format("{} is one photo: name the folder that holds all of them", name);
  if (kModels.contains(ending))
    return fmt::format(
        "{} is a model: `gemsplat view {}` shows it, and training on the folder of its photos "
        "starts from it with --from {}",
        name, path.string(), path.string());
  if (kCameras.contains(ending))
    return fmt::format(
        "{} is one file of a scene: name the folder that holds the photos and the cameras "
        "(COLMAP's "
        "sparse/0, or transforms.json)",
        name);
  if (ending == ".toml")
    return fmt::format("{} is a file of settings: give it with -c, and the scene's folder", name);
  return fmt::format("{} is a file; name the folder that holds the photos", name);
}

}  // namespace gs
