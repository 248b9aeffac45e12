// SPDX-License-Identifier: Apache-2.0
// Writing trained Gaussians and sparse points as PLY: rows are gathered column by column in a
// cache-sized block, as they are read.
#include <spdlog/fmt/fmt.h>

#include <algorithm>
#include <bit>
#include <cstring>

#include "gs_core/error.h"
#include "gs_core/geometry/world_offset.h"
#include "gs_core/system/files/atomic_file.h"
#include "gs_core/system/version.h"
#include "gs_model/formats/coding/finite_rows.h"
#include "gs_model/formats/ply/ply.h"
#include "gs_model/formats/ply/ply_layout.h"

namespace gs {
namespace {

static_assert(std::endian::native == std::endian::little);

constexpr std::size_t kBlockRows = 512;  // 124 KiB at degree 3: rows and their columns stay in L2
constexpr const char* kNormals[] = {"nx", "ny", "nz"};

std::string header_begin(std::string_view comments, std::size_t rows) {
  return fmt::format("ply\nformat binary_little_endian 1.0\n{}element vertex {}\n", comments, rows);
}

std::string first_comments(const Vec3d& offset, std::string_view others = {}) {
  return fmt::format(
      "comment gemsplat {}\n{}{}", kVersion, others,
      offset == Vec3d(0.0) ? "" : fmt::format("comment world_offset {}\n", text_of_offset(offset)));
}

std::string property_line(std::string_view name, std::string_view type = "float") {
  return fmt::format("property {} {}\n", type, name);
}

/// Where the columns of the file begin within a row of floats: the normals stand behind x y z.
std::size_t float_in_row(std::size_t column) {
  return column < 3 ? column : column + std::size(kNormals);
}

}  // namespace

std::string comments_of(const GaussianModel& model) {
  return first_comments(model.world_offset, fmt::format("comment SplatRenderMode: {}\n",
                                                        model.antialiased ? "mip" : "default"));
}

std::size_t write_gaussian_ply(ByteSink& sink, const GaussianModel& model) {
  GS_CHECK(model.sh_degree >= 0 && model.sh_degree <= kMaxShDegree);
  const std::vector<std::uint32_t> rows = finite_rows(model.gaussians, model.sh_degree);
  const std::vector<PlyColumn> columns = gaussian_columns(model.gaussians, model.sh_degree);
  const std::size_t width = columns.size() + std::size(kNormals);  // floats in a row

  std::string header = header_begin(comments_of(model), rows.size());
  std::vector<std::size_t> quaternions;  // where they begin within a row of floats
  for (std::size_t c = 0; c < columns.size(); ++c) {
    if (columns[c].property == kFirstOfRotation || columns[c].property == kFirstOfRightRotation)
      quaternions.push_back(float_in_row(c));
    if (c == 3) {
      for (const char* name : kNormals) header += property_line(name);
    }
    header += property_line(columns[c].property);
  }
  sink.write(header + "end_header\n");

  std::vector<float> block(kBlockRows * width, 0.0f);  // (kBlockRows, width); the normals stay 0
  for (std::size_t first = 0; first < rows.size(); first += kBlockRows) {
    const std::size_t count = std::min(kBlockRows, rows.size() - first);
    for (std::size_t c = 0; c < columns.size(); ++c) {
      const float* from = columns[c].array + columns[c].offset;
      float* to = block.data() + float_in_row(c);
      for (std::size_t i = 0; i < count; ++i)
        to[i * width] = from[rows[first + i] * columns[c].stride];
    }
    for (const std::size_t quaternion : quaternions)
      for (std::size_t i = 0; i < count; ++i) normalize(&block[i * width + quaternion]);
    sink.write(block.data(), count * width * sizeof(float));
  }
  return warn_of_left_out(sink.name(), rows.size(), model.gaussians.count());
}

std::size_t write_gaussian_ply(const std::filesystem::path& path, const GaussianModel& model) {
  AtomicFile file(path);
  const std::size_t left_out = write_gaussian_ply(file, model);
  file.commit();
  return left_out;
}

void write_point_ply(const std::filesystem::path& path, const std::vector<ScenePoint>& points,
                     const Vec3d& world_offset) {
  constexpr std::size_t kRowBytes = 6 * sizeof(float) + 3;
  std::string header = header_begin(first_comments(world_offset), points.size());
  for (const char* name : {"x", "y", "z", "nx", "ny", "nz"}) header += property_line(name);
  for (const char* name : {"red", "green", "blue"}) header += property_line(name, "uchar");
  std::vector<std::uint8_t> rows(points.size() * kRowBytes, 0);
  for (std::size_t i = 0; i < points.size(); ++i) {
    std::memcpy(&rows[i * kRowBytes], &points[i].position, sizeof(points[i].position));
    std::copy(points[i].color.begin(), points[i].color.end(),
              &rows[i * kRowBytes + 6 * sizeof(float)]);
  }
  AtomicFile file(path);
  file.write(header + "end_header\n");
  file.write(rows.data(), rows.size());
  file.commit();
}

}  // namespace gs
