// SPDX-License-Identifier: Apache-2.0
#include "gs_model/formats/ply/compressed_ply.h"

#include <spdlog/fmt/fmt.h>

#include <algorithm>

#include "gs_core/threads/parallel.h"
#include "gs_model/formats/coding/little_endian.h"
#include "gs_model/formats/coding/morton_rows.h"
#include "gs_model/formats/coding/quantize.h"
#include "gs_model/formats/ply/ply_layout.h"

namespace gs {
namespace {

constexpr std::size_t kChunkRows = 256;
constexpr float kLargestLogScale = 20;
constexpr float kNarrow = 1e-5f;  // a range that is narrower has no fractions
constexpr float kShPerUnit = 32;  // steps of a coefficient: from -4 to 4

constexpr const char* kVertexProperties[] = {"packed_position", "packed_rotation", "packed_scale",
                                             "packed_color"};
constexpr const char* kRangeProperties[] = {
    "min_x",       "min_y",       "min_z",       "max_x",       "max_y",       "max_z",
    "min_scale_x", "min_scale_y", "min_scale_z", "max_scale_x", "max_scale_y", "max_scale_z",
    "min_r",       "min_g",       "min_b",       "max_r",       "max_g",       "max_b"};
constexpr std::size_t kRangesWithoutColor = 12;

struct Packed {
  std::uint32_t position, rotation, scale, color;
};

/// Smallest and largest of three quantities in a chunk, as they stand in the file.
struct Range {
  Vec3f low{0}, high{0};

  void include(const Vec3f& v) {
    for (int axis = 0; axis < 3; ++axis) {
      low[axis] = std::min(low[axis], v[axis]);
      high[axis] = std::max(high[axis], v[axis]);
    }
  }
  Vec3f fraction(const Vec3f& v) const {
    Vec3f result;
    for (int axis = 0; axis < 3; ++axis) {
      const float width = high[axis] - low[axis];
      result[axis] = width < kNarrow ? 0 : (v[axis] - low[axis]) / width;
    }
    return result;
  }
  Vec3f at(const Vec3f& fraction) const { return low + (high - low) * fraction; }
};
struct Chunk {
  Range mean, log_scale, color;
};
static_assert(sizeof(Chunk) == 18 * sizeof(float));

std::uint32_t pack_11_10_11(const Vec3f& fraction) {
  return to_unorm(fraction.x, 11) << 21 | to_unorm(fraction.y, 10) << 11 | to_unorm(fraction.z, 11);
}
Vec3f unpack_11_10_11(std::uint32_t packed) {
  return {from_unorm(packed >> 21, 11), from_unorm(packed >> 11, 10), from_unorm(packed, 11)};
}

std::uint32_t pack_rotation(const Quatf& q) {
  const SmallestThree parts = smallest_three({q.w, q.x, q.y, q.z});
  std::uint32_t packed = std::uint32_t(parts.largest);
  for (const float part : parts.others)
    packed = packed << 10 | to_unorm(part * kSqrtHalf + 0.5f, 10);
  return packed;
}
Quatf unpack_rotation(std::uint32_t packed) {
  const auto part = [&](int shift) { return (from_unorm(packed >> shift, 10) - 0.5f) / kSqrtHalf; };
  const auto [w, x, y, z] = quaternion_of({int(packed >> 30), {part(20), part(10), part(0)}});
  return {w, x, y, z};
}

Vec3f color_of(const Vec3f& sh0) {
  return {color_of_sh0(sh0.x), color_of_sh0(sh0.y), color_of_sh0(sh0.z)};
}
Vec3f kept_log_scale(const Vec3f& s) {
  return {clamp_to(s.x, -kLargestLogScale, kLargestLogScale),
          clamp_to(s.y, -kLargestLogScale, kLargestLogScale),
          clamp_to(s.z, -kLargestLogScale, kLargestLogScale)};
}

Chunk chunk_of(const Gaussians& g, std::size_t begin, std::size_t end) {
  Chunk chunk;
  const auto start = [](Range& range, const Vec3f& v) { range = {v, v}; };
  start(chunk.mean, g.mean[begin]);
  start(chunk.log_scale, kept_log_scale(g.log_scale[begin]));
  start(chunk.color, color_of(g.sh0[begin]));
  for (std::size_t i = begin + 1; i < end; ++i) {
    chunk.mean.include(g.mean[i]);
    chunk.log_scale.include(kept_log_scale(g.log_scale[i]));
    chunk.color.include(color_of(g.sh0[i]));
  }
  return chunk;
}

Packed packed_row(const Gaussians& g, std::size_t i, const Chunk& chunk) {
  const Vec3f color = chunk.color.fraction(color_of(g.sh0[i]));
  return {pack_11_10_11(chunk.mean.fraction(g.mean[i])), pack_rotation(g.rotation[i]),
          pack_11_10_11(chunk.log_scale.fraction(kept_log_scale(g.log_scale[i]))),
          to_unorm(color.x, 8) << 24 | to_unorm(color.y, 8) << 16 | to_unorm(color.z, 8) << 8 |
              opacity_byte(g.logit_opacity[i])};
}

void unpack_row(const Gaussians& g, std::size_t i, const Packed& packed, const Chunk& chunk) {
  g.mean[i] = chunk.mean.at(unpack_11_10_11(packed.position));
  g.rotation[i] = unpack_rotation(packed.rotation);
  g.log_scale[i] = chunk.log_scale.at(unpack_11_10_11(packed.scale));
  const Vec3f color =
      chunk.color.at({from_unorm(packed.color >> 24, 8), from_unorm(packed.color >> 16, 8),
                      from_unorm(packed.color >> 8, 8)});
  g.sh0[i] = {sh0_of_color(color.x), sh0_of_color(color.y), sh0_of_color(color.z)};
  g.logit_opacity[i] = logit_of_byte(packed.color & 255);
}

// The bytes of f_rest_0.. of all rows.
std::string packed_sh(const Gaussians& g, int sh_degree) {
  const int rest = sh_rest_count(sh_degree);
  std::string bytes(g.count() * 3 * rest, '\0');
  parallel_for(g.count(), 4096, [&](std::size_t i) {
    char* to = bytes.data() + i * 3 * rest;
    for (int channel = 0; channel < 3; ++channel)
      for (int k = 0; k < rest; ++k)
        *to++ =
            char(rounded(std::floor(g.sh_rest[i].coefficient[k][channel] * kShPerUnit + 128), 255));
  });
  return bytes;
}

std::string header_of(const GaussianModel& model, std::size_t chunks) {
  std::string header = fmt::format("ply\nformat binary_little_endian 1.0\n{}element chunk {}\n",
                                   comments_of(model), chunks);
  for (const char* name : kRangeProperties) header += fmt::format("property float {}\n", name);
  header += fmt::format("element vertex {}\n", model.gaussians.count());
  for (const char* name : kVertexProperties) header += fmt::format("property uint {}\n", name);
  if (model.sh_degree > 0) header += fmt::format("element sh {}\n", model.gaussians.count());
  for (int i = 0; i < 3 * sh_rest_count(model.sh_degree); ++i)
    header += fmt::format("property uchar f_rest_{}\n", i);
  return header + "end_header\n";
}

[[noreturn]] void damaged(const PlyFile& file, const std::string& what) {
  cannot_read(file.path(),
              "as a compressed PLY it " + what + "; the file is damaged, export it again");
}

// The columns of `names` in rows of T, each of which has to be there.
template <class T>
PlyTable table_of(const PlyFile& file, const PlyElement& element, std::vector<T>& rows,
                  const char* const* names, std::size_t count, bool is_word) {
  PlyTable table{&element, {}};
  for (std::size_t c = 0; c < count; ++c) {
    const int property = element.find(names[c]);
    if (property < 0) damaged(file, fmt::format("lacks {} in \"{}\"", names[c], element.name));
    if (is_word && element.properties[property].type != PlyType::uint32)
      damaged(file, fmt::format("has {} as another type than uint", names[c]));
    table.columns.push_back(
        {names[c], reinterpret_cast<float*>(rows.data()), c, sizeof(T) / sizeof(float), is_word});
  }
  return table;
}

// The columns of the element "sh", in place; none where there is no such element. Sets the degree.
PlyTable sh_table(const PlyFile& file, GaussianModel& model) {
  const PlyElement* sh = file.header().find("sh");
  model.sh_degree = sh ? sh_degree_of(*sh, file.path()) : 0;
  if (model.sh_degree == 0) return {};
  if (sh->count != model.gaussians.count())
    damaged(file, fmt::format("has SH of {} Gaussians, and {} Gaussians", sh->count,
                              model.gaussians.count()));
  PlyTable table{sh, {}};
  for (const PlyColumn& column : gaussian_columns(model.gaussians, model.sh_degree)) {
    if (!column.property.starts_with("f_rest_")) continue;
    if (sh->find(column.property) < 0) damaged(file, "lacks " + column.property);
    table.columns.push_back(column);
  }
  return table;
}

}  // namespace

bool is_compressed_ply(const PlyHeader& header) {
  const PlyElement* vertex = header.find("vertex");
  return vertex && vertex->find("packed_position") >= 0;
}

GaussianModel read_compressed_ply(PlyFile& file) {
  const PlyElement* vertex = file.header().find("vertex");
  const PlyElement* chunk = file.header().find("chunk");
  if (!chunk) damaged(file, "has no element \"chunk\"");
  const std::uint64_t count = vertex->count, chunks = (count + kChunkRows - 1) / kChunkRows;
  if (chunk->count < chunks)
    damaged(file, fmt::format("has {} chunks, too few for {} Gaussians", chunk->count, count));
  Chunk without_color;
  without_color.color = {Vec3f(0), Vec3f(1)};
  std::vector<Chunk> ranges(chunk->count, without_color);
  std::vector<Packed> rows(count);
  const bool has_color = chunk->find("min_r") >= 0;
  std::vector<PlyTable> tables = {
      table_of(file, *chunk, ranges, kRangeProperties,
               has_color ? std::size(kRangeProperties) : kRangesWithoutColor, false),
      table_of(file, *vertex, rows, kVertexProperties, std::size(kVertexProperties), true)};
  GaussianModel model;
  take_comments(file.header(), model);
  model.gaussians.resize(count);
  model.gaussians.sh_rest.fill_zero();
  if (PlyTable sh = sh_table(file, model); sh.element) tables.push_back(std::move(sh));
  file.read_tables(tables);
  parallel_for(count, 4096, [&](std::size_t i) {
    unpack_row(model.gaussians, i, rows[i], ranges[i / kChunkRows]);
    for (int k = 0; k < sh_rest_count(model.sh_degree); ++k) {
      Vec3f& c = model.gaussians.sh_rest[i].coefficient[k];
      c = (c + Vec3f(0.5f - 128)) / kShPerUnit;  // the middle of the step
    }
  });
  return model;
}

void write_compressed_ply(ByteSink& sink, const GaussianModel& unsorted) {
  const GaussianModel model = in_morton_order(unsorted);
  const Gaussians& g = model.gaussians;
  const std::size_t chunks = (g.count() + kChunkRows - 1) / kChunkRows;
  std::vector<Chunk> ranges(chunks);
  std::vector<Packed> rows(g.count());
  parallel_for(chunks, 16, [&](std::size_t c) {
    const std::size_t begin = c * kChunkRows, end = std::min(begin + kChunkRows, g.count());
    ranges[c] = chunk_of(g, begin, end);
    for (std::size_t i = begin; i < end; ++i) rows[i] = packed_row(g, i, ranges[c]);
  });
  sink.write(header_of(model, chunks));
  sink.write(ranges.data(), ranges.size() * sizeof(Chunk));
  sink.write(rows.data(), rows.size() * sizeof(Packed));
  sink.write(packed_sh(g, model.sh_degree));
}

}  // namespace gs
