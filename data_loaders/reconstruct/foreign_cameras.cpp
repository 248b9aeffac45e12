// SPDX-License-Identifier: Apache-2.0
#include "data_loaders/reconstruct/foreign_cameras.h"

#include <spdlog/fmt/fmt.h>

#include "data_loaders/foreign/foreign_scene.h"
#include "data_loaders/reconstruct/photo_walk.h"
#include "gs_core/system/text/ascii.h"

namespace gs {
namespace {

namespace fs = std::filesystem;

struct Kind {
  const char* name_end;  // of the file's name, in lower case
  const char* content;   // in its first bytes; empty: any
  const char* program;
  const char* way;
};

constexpr const char* kMetashape =
    "export them there (File, Export, Export Cameras, type Agisoft XML or Colmap)";
constexpr const char* kRealityCapture =
    "export them there (Alignment, Export, Registration, type Internal/External camera parameters, "
    "or COLMAP with undistorted photos)";

constexpr Kind kKinds[] = {
    {".psx", "", "Metashape", kMetashape},
    {".csv", "#cameras ", "RealityCapture", kRealityCapture},
    {".xmp", "xcr:", "RealityCapture", kRealityCapture},
    {".rcproj", "", "RealityCapture", kRealityCapture},
};

}  // namespace

std::optional<ForeignCameras> find_foreign_cameras(const fs::path& folder) {
  for (const fs::path& file : files_in(folder, true)) {
    const std::string name = lowercase(file.filename().string());
    std::string head;
    for (const Kind& kind : kKinds) {
      if (!name.ends_with(kind.name_end)) continue;
      if (head.empty()) head = beginning_of(file);
      if (head.find(kind.content) != head.npos) return {{file, kind.program, kind.way}};
    }
  }
  return {};
}

std::string text_of(const ForeignCameras& cameras, const fs::path& folder) {
  return fmt::format(
      "{} holds camera poses of {}, which gemsplat does not read: {}, and name the folder that "
      "this "
      "gives; or let COLMAP place the photos anew with `gemsplat reconstruct {} -o SCENE`",
      cameras.file.string(), cameras.program, cameras.way, folder.string());
}

}  // namespace gs
