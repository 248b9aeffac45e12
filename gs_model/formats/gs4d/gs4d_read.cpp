// SPDX-License-Identifier: Apache-2.0
#include <spdlog/fmt/fmt.h>

#include <algorithm>
#include <cmath>

#include "gs_core/system/byte_reader.h"
#include "gs_core/threads/parallel.h"
#include "gs_model/formats/coding/little_endian.h"
#include "gs_model/formats/coding/quantize.h"
#include "gs_model/formats/gs4d/gs4d.h"
#include "gs_model/formats/gs4d/gs4d_layout.h"
#include "gs_model/formats/gs4d/moving_gaussian.h"

namespace gs {
namespace {

using Path = std::filesystem::path;

// Numbers of ranges beyond these are no positions, times or logarithms of sizes.
constexpr float kMostUnits = 2e18f, kMostLog = 200;

[[noreturn]] void damaged(const Path& path, const std::string& what) {
  cannot_read(path, what + "; the file is damaged, copy or export it again");
}

Gs4dHeader checked_header(ByteReader& reader) {
  const Path& path = reader.path();
  if (reader.size() < sizeof(Gs4dHeader) ||
      load_little<std::uint32_t>(reader.peek(sizeof(Gs4dHeader))) != kGs4dMagic)
    cannot_read(path,
                "this is not a .gs4d file: it does not begin with \"GS4D\"; check what it is");
  const auto header = load_little<Gs4dHeader>(reader.take(sizeof(Gs4dHeader)));
  if (header.version == 2)
    cannot_read(
        path,
        "it is a .gs4d of version 2, with colors that change in time, which this version of "
        "gemsplat does not draw; export the model that it was made of again");
  if (header.version != kGs4dVersion)
    cannot_read(path, fmt::format("it is a .gs4d of version {}, but gemsplat reads version {}; "
                                  "export it again as one of that",
                                  header.version, kGs4dVersion));
  if (header.sh_degree > kMaxShDegree)
    damaged(path, fmt::format("its SH degree is {}, but .gs4d ends at {}", header.sh_degree,
                              kMaxShDegree));
  if (header.chunks > reader.left() / sizeof(Gs4dChunk))
    damaged(path, fmt::format("it promises {} chunks in {} bytes", header.chunks, reader.size()));
  return header;
}

// Every size is that of the file before memory is allocated for Gaussians.
std::vector<Gs4dChunk> checked_table(ByteReader& reader, const Gs4dHeader& header) {
  std::vector<Gs4dChunk> table(header.chunks);
  std::uint64_t count = 0, bytes = 0;
  for (Gs4dChunk& chunk : table) {
    chunk = load_little<Gs4dChunk>(reader.take(sizeof(Gs4dChunk)));
    if (chunk.count == 0 || chunk.count > kGs4dChunk ||
        chunk.bytes != Gs4dArrays(chunk.count, header.sh_degree).end)
      damaged(reader.path(),
              fmt::format("a chunk promises {} Gaussians in {} bytes", chunk.count, chunk.bytes));
    count += chunk.count;
    bytes += chunk.bytes;
  }
  if (count != header.count)
    damaged(reader.path(),
            fmt::format("its header promises {} Gaussians and its table {}", header.count, count));
  if (bytes != reader.left())
    damaged(reader.path(),
            fmt::format("its chunks have {} bytes, but {} follow the table", bytes, reader.left()));
  return table;
}

bool is_within(float value, float most) { return std::abs(value) <= most; }  // not NaN
bool is_within(const Vec3f& v, float most) {
  return is_within(v.x, most) && is_within(v.y, most) && is_within(v.z, most);
}
bool is_within(const Gs4dRange& range, float most) {
  return is_within(range.low, most) && is_within(range.step, most);
}
bool is_sound(const Gs4dBlock& block) {
  return is_within(block.position_low, kMostUnits) && is_within(block.position_step, kMostUnits) &&
         is_within(block.drift_step, kMostUnits) && is_within(block.time_mean, kMostUnits) &&
         is_within(block.log_time_scale, kMostLog) && is_within(block.log_scale, kMostLog) &&
         is_within(block.sh0, kMostUnits) && is_within(block.sh_step, kMostUnits);
}

Quat<double> rotation_of(std::uint32_t word) {
  SmallestThree parts{int(word >> 30), {}};
  for (int i = 0; i < 3; ++i) {
    const int steps = int((word >> 10 * i & 1023u) ^ 512u) - 512;  // ten bits with a sign
    parts.others[i] = float(steps) / kGs4dRotationSteps * kSqrtHalf;
  }
  const auto [w, x, y, z] = quaternion_of(parts);
  return normalized(Quat<double>{w, x, y, z});
}

void read_row(const std::uint8_t* chunk, const Gs4dArrays& at, const Gs4dBlock& block,
              int sh_degree, std::size_t i, const Gaussians& to, std::size_t row) {
  const auto word = [&](std::size_t array, std::size_t k) {
    return load_little<std::uint16_t>(chunk + array + 2 * k);
  };
  // Logarithms that a damaged block makes larger than any are cut.
  const auto log_of = [](const Gs4dRange& range, std::uint32_t steps) {
    return std::clamp(double(range.value(steps)), -double(kMostLog), double(kMostLog));
  };
  MovingGaussian moving{};
  for (int k = 0; k < 3; ++k) {
    moving.mean[k] =
        block.position_low[k] + block.position_step[k] * float(word(at.positions, 3 * i + k));
    moving.drift[k] = block.drift_step[k] * float(std::int16_t(word(at.drifts, 3 * i + k)));
    moving.log_scale[k] = log_of(block.log_scale, chunk[at.scales + 3 * i + k]);
    to.sh0[row][k] = block.sh0.value(chunk[at.colors + 3 * i + k]);
  }
  moving.time_mean = block.time_mean.value(word(at.times, 2 * i));
  moving.log_time_scale = log_of(block.log_time_scale, word(at.times, 2 * i + 1));
  moving.rotation = rotation_of(load_little<std::uint32_t>(chunk + at.rotations + 4 * i));
  const SpacetimeShape<double> shape = shape_of(moving);
  const auto quat = [](const Quat<double>& q) {
    return Quatf{float(q.w), float(q.x), float(q.y), float(q.z)};
  };
  to.mean[row] = Vec3f(shape.mean);
  to.log_scale[row] = Vec3f(shape.log_scale);
  to.log_time_scale[row] = float(shape.log_time_scale);
  to.rotation[row] = quat(shape.rotations.left);
  to.right_rotation[row] = quat(shape.rotations.right);
  to.time_mean[row] = float(shape.time_mean);
  to.logit_opacity[row] = logit_of_byte(chunk[at.opacities + i]);
  const int rest = sh_rest_count(sh_degree);
  for (int c = 0; c < rest; ++c)
    for (int k = 0; k < 3; ++k)
      to.sh_rest[row].coefficient[c][k] =
          block.sh_step *
          float(std::int8_t(chunk[at.sh + std::size_t(3 * (std::ptrdiff_t(i) * rest + c) + k)]));
}

}  // namespace

GaussianModel read_gs4d(const std::filesystem::path& path) {
  ByteReader reader(path);
  const Gs4dHeader header = checked_header(reader);
  const std::vector<Gs4dChunk> table = checked_table(reader, header);
  GaussianModel model{Gaussians(), header.sh_degree, false, (header.flags & kGs4dAntialiased) != 0};
  model.gaussians.has_time = true;
  model.gaussians.resize(header.count);
  model.gaussians.sh_rest.fill_zero();
  std::size_t first = 0;
  for (const Gs4dChunk& entry : table) {
    const Gs4dArrays at(entry.count, header.sh_degree);
    const std::uint8_t* const chunk = reader.take(entry.bytes);
    const auto block_of = [&](std::size_t i) {
      Gs4dBlock block{};
      std::memcpy(&block, chunk + i / kGs4dBlock * sizeof block, sizeof block);
      return block;
    };
    for (std::size_t i = 0; i < entry.count; i += kGs4dBlock)
      if (!is_sound(block_of(i))) damaged(path, "a block has a range that no Gaussians have");
    parallel_for(entry.count, 1024, [&](std::size_t i) {
      read_row(chunk, at, block_of(i), header.sh_degree, i, model.gaussians, first + i);
    });
    first += entry.count;
  }
  return model;
}

}  // namespace gs
