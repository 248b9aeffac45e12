// SPDX-License-Identifier: Apache-2.0
// Writes .ksplat files for tests, by the text of ksplat.h. gemsplat itself only reads them.
#pragma once

#include <algorithm>
#include <string>

#include "gs_core/gaussians.h"
#include "gs_model/formats/coding/half.h"
#include "gs_model/formats/coding/little_endian.h"
#include "gs_model/formats/coding/quantize.h"

namespace gs {

struct KsplatOptions {
  unsigned level = 1;
  std::uint32_t bucket_rows = 4, range = 32767;
  float block = 5;  // side of a bucket, world units
  float least_sh = -1.5f, largest_sh = 1.5f;
  std::uint32_t rows_per_section = 1000;  // the last one has fewer
};

namespace ksplat {

/// A number of a row: a float, or a half.
inline void append_number(std::string& bytes, float value, unsigned level) {
  if (level == 0)
    append_little(bytes, value);
  else
    append_little(bytes, to_half(value));
}

inline void append_row(std::string& bytes, const GaussianModel& model, std::size_t i,
                       const Vec3f& center, const KsplatOptions& options) {
  const Gaussians& g = model.gaussians;
  const float steps = 2 * float(options.range) / options.block;
  for (int axis = 0; axis < 3; ++axis) {
    const float packed =
        std::round((g.mean[i][axis] - center[axis]) * steps) + float(options.range);
    if (options.level == 0)
      append_little(bytes, g.mean[i][axis]);
    else
      append_little(bytes, std::uint16_t(clamp_to(packed, 0.0f, 65535.0f)));
  }
  for (int axis = 0; axis < 3; ++axis)
    append_number(bytes, std::exp(g.log_scale[i][axis]), options.level);
  const Quatf& q = g.rotation[i];
  for (const float part : {q.w, q.x, q.y, q.z}) append_number(bytes, part, options.level);
  for (int channel = 0; channel < 3; ++channel)
    bytes += char(to_unorm(color_of_sh0(g.sh0[i][channel]), 8));
  bytes += char(opacity_byte(g.logit_opacity[i]));
  for (int degree = 1; degree <= model.sh_degree; ++degree)
    for (int channel = 0; channel < 3; ++channel)
      for (int k = sh_rest_count(degree - 1); k < sh_rest_count(degree); ++k) {
        const float c = g.sh_rest[i].coefficient[k][channel];
        const float width = options.largest_sh - options.least_sh;
        if (options.level < 2)
          append_number(bytes, c, options.level);
        else
          bytes += char(to_unorm((c - options.least_sh) / width, 8));
      }
}

inline void put(std::string& header, std::size_t at, const auto& value) {
  header.replace(at, sizeof value, reinterpret_cast<const char*>(&value), sizeof value);
}

/// Rows first..end of a model: full buckets first, and then one of the rest, around their first
/// rows.
inline void append_section(std::string& headers, std::string& data, const GaussianModel& model,
                           std::size_t first, std::size_t end, const KsplatOptions& options) {
  const auto rows = std::uint32_t(end - first), full = rows / options.bucket_rows;
  const std::uint32_t rest = rows % options.bucket_rows, others = rest ? 1 : 0;
  std::string header(1024, '\0');
  put(header, 0, rows);
  put(header, 4, rows);
  put(header, 40, std::uint16_t(model.sh_degree));
  const bool is_packed = options.level > 0;
  if (is_packed) {
    put(header, 8, options.bucket_rows);
    put(header, 12, full + others);
    put(header, 16, options.block);
    put(header, 20, std::uint16_t(12));
    put(header, 24, options.range);
    put(header, 32, full);
    put(header, 36, others);
    if (rest) append_little(data, rest);
    for (std::size_t bucket = 0; bucket < full + others; ++bucket)
      append_little(data, model.gaussians.mean[first + bucket * options.bucket_rows]);
  }
  headers += header;
  for (std::size_t i = first; i < end; ++i) {
    const std::size_t in_bucket = (i - first) % options.bucket_rows;
    append_row(data, model, i, model.gaussians.mean[i - in_bucket], options);
  }
}

}  // namespace ksplat

inline std::string ksplat_bytes(const GaussianModel& model, const KsplatOptions& options) {
  const std::size_t count = model.gaussians.count(), each = options.rows_per_section;
  std::string file(4096, '\0'), data;
  const auto sections = std::uint32_t((count + each - 1) / each);
  file[1] = 1;
  ksplat::put(file, 4, sections);
  ksplat::put(file, 8, sections);
  ksplat::put(file, 12, std::uint32_t(count));
  ksplat::put(file, 16, std::uint32_t(count));
  ksplat::put(file, 20, std::uint16_t(options.level));
  ksplat::put(file, 36, options.least_sh);
  ksplat::put(file, 40, options.largest_sh);
  for (std::size_t first = 0; first < count; first += each)
    ksplat::append_section(file, data, model, first, std::min(count, first + each), options);
  return file + data;
}

}  // namespace gs
