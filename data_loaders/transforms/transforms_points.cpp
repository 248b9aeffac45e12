// SPDX-License-Identifier: Apache-2.0
#include "data_loaders/transforms/transforms_points.h"

#include <spdlog/fmt/fmt.h>

#include <algorithm>
#include <cmath>

#include "gs_core/error.h"
#include "gs_core/system/byte_reader.h"
#include "gs_core/system/log.h"
#include "gs_model/formats/ply/ply_file.h"

namespace gs {
namespace {

namespace fs = std::filesystem;

constexpr float kGray = 128;  // of points without color

/// One color value as a byte. Files store it as 0 to 255, or as 0 to 1 if it is a float.
std::uint8_t color_byte(float value, PlyType type) {
  const bool is_real = type == PlyType::float32 || type == PlyType::float64;
  const float scaled = is_real ? 255 * value : value;
  return scaled > 0 ? std::uint8_t(std::min(std::round(scaled), 255.0f)) : 0;
}

std::vector<ColmapPoint> read_points(const fs::path& path) {
  PlyFile file(path);
  const PlyElement* vertex = file.header().find("vertex");
  std::vector<Vec3f> positions, colors;
  std::vector<PlyColumn> columns;
  const auto add = [&](const char* name, std::vector<Vec3f>& to, std::size_t offset) {
    columns.push_back({name, reinterpret_cast<float*>(to.data()), offset, 3});
  };
  for (const char* name : {"x", "y", "z"})
    if (!vertex || vertex->find(name) < 0)
      cannot_read(path, fmt::format("its points have no {}; export it again", name));
  positions.resize(vertex->count);
  add("x", positions, 0), add("y", positions, 1), add("z", positions, 2);
  const int red = vertex->find("red");
  const bool has_colors = red >= 0 && vertex->find("green") >= 0 && vertex->find("blue") >= 0;
  colors.assign(vertex->count, Vec3f(kGray));
  if (has_colors) add("red", colors, 0), add("green", colors, 1), add("blue", colors, 2);
  file.read_columns(*vertex, columns);

  const PlyType type = has_colors ? vertex->properties[red].type : PlyType::uint8;
  std::vector<ColmapPoint> points;
  for (std::size_t i = 0; i < positions.size(); ++i) {
    if (!is_finite(positions[i])) continue;
    const Vec3f& c = colors[i];
    points.push_back({points.size() + 1,
                      Vec3d(positions[i]),
                      {color_byte(c.x, type), color_byte(c.y, type), color_byte(c.z, type)}});
  }
  if (points.size() < positions.size())
    log_warning("{} of {} points in {} have a position that is not finite: left out",
                positions.size() - points.size(), positions.size(), path.string());
  return points;
}

}  // namespace

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
    return read_points(file.folder() / *name);
  } catch (const Error& error) {
    log_warning("{}; going on without points", error.what());
    return {};
  }
}

}  // namespace gs
