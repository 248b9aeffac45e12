// SPDX-License-Identifier: Apache-2.0
#include "data_loaders/points/point_file.h"

#include <spdlog/fmt/fmt.h>

#include <algorithm>
#include <cmath>

#include "data_loaders/points/las_file.h"
#include "gs_core/error.h"
#include "gs_core/system/byte_reader.h"
#include "gs_core/system/log.h"
#include "gs_core/system/text/ascii.h"
#include "gs_model/formats/ply/ply_file.h"

namespace gs {
namespace {

namespace fs = std::filesystem;

constexpr float kGray = 128;  // of points without color
// Names of the colors; those of the programs that ours come from, and of older ones.
constexpr const char* kColorNames[][3] = {
    {"red", "green", "blue"}, {"diffuse_red", "diffuse_green", "diffuse_blue"}, {"r", "g", "b"}};

std::string ending_of(const fs::path& path) { return lowercase(path.extension().string()); }

bool has_all(const PlyElement& element, const char* const (&names)[3]) {
  return std::all_of(std::begin(names), std::end(names),
                     [&](const char* name) { return element.find(name) >= 0; });
}

/// One color value as a byte. Files store it as 0 to 255, as 0 to 65535 if it is a 16-bit number, or
/// as 0 to 1 if it is a float.
std::uint8_t color_byte(float value, PlyType type) {
  float scaled = value;
  if (type == PlyType::float32 || type == PlyType::float64) scaled = 255 * value;
  if (type == PlyType::uint16) scaled = value / 257;
  return scaled > 0 ? std::uint8_t(std::min(std::round(scaled), 255.0f)) : 0;
}

std::vector<ColmapPoint> read_ply_points(const fs::path& path) {
  PlyFile file(path);
  const PlyElement* vertex = file.header().find("vertex");
  for (const char* name : {"x", "y", "z"})
    if (!vertex || vertex->find(name) < 0)
      cannot_read(path, fmt::format("its points have no {}; export it again", name));
  std::vector<Vec3d> positions(vertex->count);
  std::vector<Vec3f> colors(vertex->count, Vec3f(kGray));
  std::vector<PlyColumn> columns;
  for (std::size_t axis = 0; axis < 3; ++axis) {
    PlyColumn& column = columns.emplace_back();
    column.property = std::string(1, "xyz"[axis]);
    column.doubles = reinterpret_cast<double*>(positions.data());
    column.offset = axis, column.stride = 3;
  }
  PlyType type = PlyType::uint8;
  for (const auto& names : kColorNames) {
    if (!has_all(*vertex, names)) continue;
    for (std::size_t k = 0; k < 3; ++k)
      columns.push_back({names[k], reinterpret_cast<float*>(colors.data()), k, 3});
    type = vertex->properties[std::size_t(vertex->find(names[0]))].type;
    break;
  }
  file.read_columns(*vertex, columns);

  const std::size_t every = (positions.size() + kMostPointsOfFile - 1) / kMostPointsOfFile;
  std::vector<ColmapPoint> points;
  std::size_t lost = 0;
  for (std::size_t i = 0; i < positions.size(); i += every) {
    const Vec3f& c = colors[i];
    if (is_finite(positions[i]))
      points.push_back({points.size() + 1,
                        positions[i],
                        {color_byte(c.x, type), color_byte(c.y, type), color_byte(c.z, type)}});
    else
      ++lost;
  }
  if (lost > 0)
    log_warning("{} of {} points in {} have a position that is not finite: left out", lost,
                points.size() + lost, path.string());
  return points;
}

}  // namespace

std::vector<ColmapPoint> read_point_file(const fs::path& path) {
  const std::string ending = ending_of(path);
  return ending == ".las" || ending == ".laz" ? read_las_points(path) : read_ply_points(path);
}

PointFileKind point_file_kind(const fs::path& path) {
  const std::string ending = ending_of(path);
  if (ending == ".las" || ending == ".laz") return PointFileKind::points;
  if (ending != ".ply") return PointFileKind::none;
  try {
    const PlyFile file(path);
    const PlyElement* vertex = file.header().find("vertex");
    constexpr const char* kPosition[] = {"x", "y", "z"};
    if (!vertex || vertex->count == 0 || !has_all(*vertex, kPosition) ||
        vertex->find("f_dc_0") >= 0 || vertex->find("packed_position") >= 0)
      return PointFileKind::none;
    const PlyElement* face = file.header().find("face");
    return face && face->count > 0 ? PointFileKind::mesh : PointFileKind::points;
  } catch (const Error&) {  // no PLY that anybody reads
    return PointFileKind::none;
  }
}

}  // namespace gs
