// SPDX-License-Identifier: Apache-2.0
#include <spdlog/fmt/fmt.h>

#include <algorithm>

#include "gs_core/system/byte_reader.h"
#include "gs_core/system/log.h"
#include "gs_core/threads/parallel.h"
#include "gs_model/formats/coding/compression.h"
#include "gs_model/formats/coding/count_check.h"
#include "gs_model/formats/coding/finite_rows.h"
#include "gs_model/formats/coding/frame.h"
#include "gs_model/formats/coding/little_endian.h"
#include "gs_model/formats/coding/quantize.h"
#include "gs_model/formats/spz/spz.h"
#include "gs_model/formats/spz/spz_layout.h"

namespace gs {
namespace {

using Path = std::filesystem::path;
using Arrays = std::array<std::string, kSpzArrays>;

[[noreturn]] void fail_as_no_spz(const Path& path) {
  cannot_read(path,
              "this is not an .spz file: it begins neither with \"NGSP\" nor as gzip files do; "
              "check what it is");
}

void check_magic(const Path& path, std::string_view first) {
  constexpr std::string_view kGzipMagic = "\x1F\x8B";
  if (first.size() < sizeof(std::uint32_t)) return;  // too short for either
  if (!first.starts_with(kGzipMagic) && load_little<std::uint32_t>(first.data()) != kSpzMagic)
    fail_as_no_spz(path);
}

void check_header(const SpzHeader& header, const Path& path, std::uint64_t file_bytes) {
  if (header.magic != kSpzMagic) fail_as_no_spz(path);
  if (header.version < 2 || header.version > 4)
    cannot_read(path,
                fmt::format("it is an .spz of version {}, but gemsplat reads 2 to 4; export it "
                            "again as version 3",
                            header.version));
  if (header.sh_degree > kSpzMaxDegree)
    cannot_read(
        path,
        fmt::format("its SH degree is {}, but .spz ends at 4; the file is damaged, export it again",
                    header.sh_degree));
  if (header.fractional_bits > 23)
    cannot_read(path, fmt::format("its positions have {} fractional bits of 24; the file is "
                                  "damaged, export it again",
                                  header.fractional_bits));
  check_count(path, header.count, file_bytes);
}

// Versions 2 and 3: one gzip file of header and arrays.
Arrays unpack_gzip(const Path& path, std::string_view file, SpzHeader& header) {
  header = load_little<SpzHeader>(gunzip(path, file, kSpzHeaderBytes, false).data());
  check_header(header, path, file.size());
  const auto row_bytes = spz_row_bytes(header.version, header.sh_degree);
  std::size_t total = kSpzHeaderBytes;
  for (const std::size_t bytes : row_bytes) total += bytes * header.count;
  const std::string all =
      gunzip(path, file, total, true);  // checked to its end before more is done
  Arrays arrays;
  std::size_t at = kSpzHeaderBytes;
  for (std::size_t s = 0; s < kSpzArrays; at += row_bytes[s++] * header.count)
    arrays[s] = all.substr(at, row_bytes[s] * header.count);
  return arrays;
}

[[noreturn]] void fail_at_streams(const Path& path) {
  cannot_read(path,
              "its table of streams does not match the file; the file is damaged, export it again");
}

// Version 4: a header in the clear, a table of streams, and a zstd frame for each. An empty array
// (SH at degree 0) has no stream; some writers give it one of 0 bytes.
Arrays unpack_zstd_streams(const Path& path, std::string_view file, SpzHeader& header) {
  header = load_little<SpzHeader>(file.data());
  check_header(header, path, file.size());
  if (header.version != 4 || file.size() < kSpzHeaderBytes + sizeof(SpzStreamTable))
    fail_at_streams(path);
  const std::size_t table = load_little<SpzStreamTable>(file.data() + kSpzHeaderBytes).offset;
  const std::size_t table_bytes = header.last * sizeof(SpzStream);
  if (table > file.size() || table_bytes > file.size() - table) fail_at_streams(path);
  const auto row_bytes = spz_row_bytes(header.version, header.sh_degree);
  Arrays arrays;
  std::size_t at = table + table_bytes, next = 0;
  for (std::size_t s = 0; s < kSpzArrays; ++s) {
    const std::size_t wanted = row_bytes[s] * header.count;
    if (wanted == 0) continue;
    SpzStream stream;
    do {
      if (next == header.last) fail_at_streams(path);
      stream = load_little<SpzStream>(file.data() + table + next++ * sizeof(SpzStream));
      if (stream.packed > file.size() - at) fail_at_streams(path);
      at += stream.packed;
    } while (stream.raw == 0);
    if (stream.raw != wanted) fail_at_streams(path);
    arrays[s] = unpack_zstd(path, file.substr(at - stream.packed, stream.packed), wanted);
  }
  return arrays;
}

float fixed24(const std::uint8_t* bytes, float step) {
  const std::uint32_t word = bytes[0] | bytes[1] << 8 | std::uint32_t(bytes[2]) << 16;
  return float(std::int32_t(word << 8) >> 8) * step;
}

// x y z w
std::array<float, 4> rotation_of(const std::uint8_t* bytes, std::uint32_t version) {
  if (version == 2) {
    const auto part = [&](int i) { return float(bytes[i]) / 127.5f - 1; };
    const float x = part(0), y = part(1), z = part(2);
    return {x, y, z, std::sqrt(std::fmax(0.0f, 1 - (x * x + y * y + z * z)))};
  }
  std::uint32_t word = load_little<std::uint32_t>(bytes);
  SmallestThree parts{int(word >> 30), {}};
  for (int i = 2; i >= 0; --i, word >>= 10) {
    const float size = float(word & kSpzRotationSteps) / kSpzRotationSteps * kSqrtHalf;
    parts.others[i] = word & (kSpzRotationSteps + 1) ? -size : size;
  }
  return quaternion_of(parts);
}

void unpack_row(const SpzHeader& header, const Arrays& arrays, const AxisSigns& signs,
                const Gaussians& g, std::size_t i) {
  const auto row_bytes = spz_row_bytes(header.version, header.sh_degree);
  const auto row = [&](std::size_t s) {
    return reinterpret_cast<const std::uint8_t*>(arrays[s].data()) + i * row_bytes[s];
  };
  const float step = std::ldexp(1.0f, -int(header.fractional_bits));
  for (int axis = 0; axis < 3; ++axis) {
    g.mean[i][axis] = signs[axis] * fixed24(row(0) + 3 * axis, step);
    g.sh0[i][axis] = (float(row(2)[axis]) - kSpzColorZero) / kSpzColorSteps;
    g.log_scale[i][axis] = float(row(3)[axis]) / kSpzScaleSteps + kSpzLeastLogScale;
  }
  g.logit_opacity[i] = logit_of_byte(*row(1));
  const auto [x, y, z, w] = rotation_of(row(4), header.version);
  g.rotation[i] = {w, signs.x * x, signs.y * y, signs.z * z};
  normalize(&g.rotation[i].w);
  for (int k = 0; k < sh_rest_count(std::min<int>(header.sh_degree, kMaxShDegree)); ++k)
    for (int channel = 0; channel < 3; ++channel)
      g.sh_rest[i].coefficient[k][channel] =
          sh_sign(k, signs) * (float(row(5)[3 * k + channel]) - kSpzShZero) / kSpzShSteps;
}

}  // namespace

GaussianModel read_spz(const std::filesystem::path& path) {
  ByteReader reader(path);
  const auto text = [](const std::uint8_t* bytes, std::size_t size) {
    return std::string_view(reinterpret_cast<const char*>(bytes), size);
  };
  const std::size_t few = std::min<std::uint64_t>(reader.size(), sizeof(std::uint32_t));
  check_magic(path, text(reader.peek(few), few));  // before the whole file is read
  const std::size_t size = reader.size();
  return spz_model(path, text(reader.take(size), size), kHalfTurnX);
}

GaussianModel spz_model(const std::filesystem::path& path, std::string_view file,
                        const AxisSigns& signs) {
  check_magic(path, file);
  SpzHeader header;
  const bool is_plain =
      file.size() >= kSpzHeaderBytes && load_little<std::uint32_t>(file.data()) == kSpzMagic;
  const Arrays arrays =
      is_plain ? unpack_zstd_streams(path, file, header) : unpack_gzip(path, file, header);
  if (header.sh_degree > kMaxShDegree)
    log_warning("{}: SH coefficients of degree 4 are left out; gemsplat renders degrees 0 to 3",
                path.string());
  GaussianModel model{Gaussians(header.count, host_memory()),
                      std::min<int>(header.sh_degree, kMaxShDegree), false,
                      (header.flags & kSpzAntialiased) != 0};
  model.gaussians.sh_rest.fill_zero();
  parallel_for(header.count, 4096,
               [&](std::size_t i) { unpack_row(header, arrays, signs, model.gaussians, i); });
  return model;
}

}  // namespace gs
