// SPDX-License-Identifier: Apache-2.0
#include "data_loaders/transforms/transforms_points.h"

#include "data_loaders/points/point_file.h"
#include "gs_core/error.h"
#include "gs_core/system/log.h"

namespace gs {

std::vector<ColmapPoint> read_transforms_points(const TransformsFile& file) {
  const auto entry = file.top.find("ply_file_path");
  if (entry == file.top.end() || entry->is_null()) return {};
  const auto name =
      entry->is_string() ? path_inside(file.folder(), entry->get<std::string>()) : std::nullopt;
  if (!name)
    file.fail(
        "ply_file_path is not a path to a file in its folder; copy the PLY there and name it "
        "relative to the folder, or leave the key out");
  try {
    return read_point_file(file.folder() / *name);
  } catch (const Error& error) {
    log_warning("{}; going on without points", error.what());
    return {};
  }
}

}  // namespace gs
