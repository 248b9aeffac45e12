// SPDX-License-Identifier: Apache-2.0
// Writing trained Gaussians and sparse points as PLY: rows are gathered column by column in a
// cache-sized block, as they are read.
#include <spdlog/fmt/fmt.h>

#include <algorithm>
#include <bit>
#include <cmath>
#include <cstring>

#include "data_loaders/atomic_file.h"
#include "data_loaders/ply.h"
#include "data_loaders/ply_layout.h"
#include "data_loaders/world_offset.h"
#include "gs_core/error.h"
#include "gs_core/log.h"
#include "gs_core/version.h"

namespace gs {
namespace {

static_assert(std::endian::native == std::endian::little);

constexpr std::size_t kBlockRows = 512;  // 124 KiB at degree 3: rows and their columns stay in L2
constexpr double kUnitTolerance = 0x1p-21;  // of a quaternion's length: a few roundings of float
constexpr const char* kNormals[] = {"nx", "ny", "nz"};

std::string header_begin(std::string_view comments, std::size_t rows) {
  return fmt::format(
      "ply\n"
      "format binary_little_endian 1.0\n"
      "comment gemsplat {}\n{}"
      "element vertex {}\n",
      kVersion, comments, rows);
}

std::string offset_comment(const Vec3d& offset) {
  return offset == Vec3d(0.0) ? ""
                              : fmt::format("comment world_offset {}\n", text_of_offset(offset));
}

std::string property_line(std::string_view name, std::string_view type = "float") {
  return fmt::format("property {} {}\n", type, name);
}

bool is_finite(float value) {
  constexpr std::uint32_t kExponent = 0x7f800000u;
  return (std::bit_cast<std::uint32_t>(value) & kExponent) != kExponent;
}

/// The rows whose written values are all finite.
std::vector<std::size_t> finite_rows(const Gaussians& gaussians, int sh_degree) {
  const int rest_floats = 3 * sh_rest_count(sh_degree);
  const auto all_finite = [](const auto& row, int count) {
    const float* values = reinterpret_cast<const float*>(&row);
    bool finite = true;
    for (int i = 0; i < count; ++i) finite &= is_finite(values[i]);
    return finite;
  };
  std::vector<std::size_t> rows;
  rows.reserve(gaussians.count());
  for (std::size_t i = 0; i < gaussians.count(); ++i) {
    if (all_finite(gaussians.mean[i], 3) && all_finite(gaussians.log_scale[i], 3) &&
        all_finite(gaussians.rotation[i], 4) && is_finite(gaussians.logit_opacity[i]) &&
        all_finite(gaussians.sh0[i], 3) && all_finite(gaussians.sh_rest[i], rest_floats)) {
      rows.push_back(i);
    }
  }
  return rows;
}

/// Scales w x y z to length 1. A quaternion that has it to float precision stays as it is, so that
/// a file that is read and written again keeps its bytes; one of length 0 becomes the identity.
void normalise(float* wxyz) {
  double squared = 0;
  for (int i = 0; i < 4; ++i) squared += double(wxyz[i]) * wxyz[i];
  const double length = std::sqrt(squared);
  if (length == 0) {
    wxyz[0] = 1;
  } else if (std::abs(length - 1) > kUnitTolerance) {
    for (int i = 0; i < 4; ++i) wxyz[i] = float(wxyz[i] / length);
  }
}

/// Where the columns of the file begin within a row of floats: the normals stand behind x y z.
std::size_t float_in_row(std::size_t column) {
  return column < 3 ? column : column + std::size(kNormals);
}

}  // namespace

std::size_t write_gaussian_ply(const std::filesystem::path& path, const GaussianModel& model) {
  GS_CHECK(model.sh_degree >= 0 && model.sh_degree <= kMaxShDegree);
  const std::vector<std::size_t> rows = finite_rows(model.gaussians, model.sh_degree);
  const std::vector<PlyColumn> columns = gaussian_columns(model.gaussians, model.sh_degree);
  const std::size_t width = columns.size() + std::size(kNormals);  // floats in a row

  std::string header = header_begin(
      fmt::format("comment SplatRenderMode: {}\n", model.antialiased ? "mip" : "default") +
          offset_comment(model.world_offset),
      rows.size());
  for (std::size_t c = 0; c < columns.size(); ++c) {
    if (c == 3) {
      for (const char* name : kNormals) header += property_line(name);
    }
    header += property_line(columns[c].property);
  }
  AtomicFile file(path);
  file.write(header + "end_header\n");

  std::vector<float> block(kBlockRows * width, 0.0f);  // (kBlockRows, width); the normals stay 0
  for (std::size_t first = 0; first < rows.size(); first += kBlockRows) {
    const std::size_t count = std::min(kBlockRows, rows.size() - first);
    for (std::size_t c = 0; c < columns.size(); ++c) {
      const float* from = columns[c].array + columns[c].offset;
      float* to = block.data() + float_in_row(c);
      for (std::size_t i = 0; i < count; ++i)
        to[i * width] = from[rows[first + i] * columns[c].stride];
    }
    for (std::size_t i = 0; i < count; ++i) normalise(&block[(i + 1) * width - 4]);
    file.write(block.data(), count * width * sizeof(float));
  }
  file.commit();

  const std::size_t left_out = model.gaussians.count() - rows.size();
  if (left_out) {
    log_warning("{}: {} of {} Gaussians hold NaN or infinity and were left out", path.string(),
                left_out, model.gaussians.count());
  }
  return left_out;
}

void write_point_ply(const std::filesystem::path& path, const std::vector<ScenePoint>& points,
                     const Vec3d& world_offset) {
  constexpr std::size_t kRowBytes = 6 * sizeof(float) + 3;
  std::string header = header_begin(offset_comment(world_offset), points.size());
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
