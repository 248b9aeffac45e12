// SPDX-License-Identifier: Apache-2.0
#include <spdlog/fmt/fmt.h>

#include <algorithm>

#include "gs_core/error.h"
#include "gs_core/system/log.h"
#include "gs_core/threads/parallel.h"
#include "gs_model/formats/coding/compression.h"
#include "gs_model/formats/coding/frame.h"
#include "gs_model/formats/coding/little_endian.h"
#include "gs_model/formats/coding/quantize.h"
#include "gs_model/formats/spz/spz.h"
#include "gs_model/formats/spz/spz_layout.h"

namespace gs {
namespace {

using Arrays = std::array<std::string, kSpzArrays>;

constexpr int kUsualFractionalBits = 12;  // those of other writers
constexpr int kLargestPosition = (1 << 23) - 1;

/// The step in which byte k of the SH counts.
std::uint32_t sh_step(const SpzOptions& options, int k) {
  const int usual_bits = k < 3 ? 5 : 4;
  return 1u << (8 - (options.sh_bits ? options.sh_bits : usual_bits));
}

float largest_position(const Gaussians& g) {
  float largest = 0;
  for (const Vec3f& mean : g.mean)
    largest = std::max({largest, std::abs(mean.x), std::abs(mean.y), std::abs(mean.z)});
  return largest;
}

/// As many as all positions leave room for, at most the usual ones; below 0 where they leave none.
int fractional_bits_for(const Gaussians& g) {
  const float largest = largest_position(g);
  int bits = kUsualFractionalBits;
  while (bits >= 0 && std::ldexp(largest, bits) > float(kLargestPosition) - 1) --bits;
  return bits;
}

void check_positions(const Gaussians& g, const std::string& name) {
  const int bits = fractional_bits_for(g);
  if (bits < 0)
    throw Error(
        fmt::format("cannot write {}: a position is {:.3g} world units from the origin, but .spz "
                    "ends at {}; add --recenter or --scale, or choose .ply",
                    name, largest_position(g), kLargestPosition));
  if (bits < kUsualFractionalBits)
    log_warning(
        "{}: positions reach {:.5g} world units, so .spz holds them in steps of 1/{} of a unit; "
        "--recenter may make these finer",
        name, largest_position(g), 1 << bits);
}

void warn_of_clamped_scales(const Gaussians& g, const std::string& name) {
  constexpr float kMost = kSpzLeastLogScale + 255 / kSpzScaleSteps;
  std::size_t large = 0;
  for (const Vec3f& s : g.log_scale)
    large += std::max({s.x, s.y, s.z}) > kMost + 0.5f / kSpzScaleSteps;
  if (large > 0)
    log_warning(
        "{}: {} Gaussians are larger than the {:.0f} world units that .spz can hold and were cut "
        "down to that size; --scale may help",
        name, large, std::exp(kMost));
}

std::uint32_t packed_rotation(const Quatf& q, const AxisSigns& signs) {
  const SmallestThree parts = smallest_three({signs.x * q.x, signs.y * q.y, signs.z * q.z, q.w});
  std::uint32_t word = std::uint32_t(parts.largest);
  for (const float part : parts.others) {
    const auto size =
        rounded(std::abs(part) / kSqrtHalf * float(kSpzRotationSteps), kSpzRotationSteps);
    word = word << 10 | (part < 0 ? kSpzRotationSteps + 1 : 0) | size;
  }
  return word;
}

// Version 2: x y z of a quaternion whose w is not negative.
void pack_rotation_bytes(const Quatf& q, const AxisSigns& signs, std::uint8_t* bytes) {
  const float sign = q.w < 0 ? -1.0f : 1.0f;
  const Vec3f axis = sign * Vec3f(q.x, q.y, q.z) * signs;
  for (int k = 0; k < 3; ++k) bytes[k] = std::uint8_t(rounded(axis[k] * 127.5f + 127.5f, 255));
}

std::uint8_t packed_sh(std::uint32_t step, float value) {
  const std::uint32_t byte = rounded(value * kSpzShSteps + kSpzShZero, 255);
  return std::uint8_t(std::min<std::uint32_t>((byte + step / 2) / step * step, 255));
}

void pack_row(const SpzHeader& header, const SpzOptions& options, const AxisSigns& signs,
              const Gaussians& g, std::size_t i, Arrays& arrays) {
  const auto row_bytes = spz_row_bytes(header.version, header.sh_degree);
  const auto row = [&](std::size_t s) {
    return reinterpret_cast<std::uint8_t*>(arrays[s].data()) + i * row_bytes[s];
  };
  for (int axis = 0; axis < 3; ++axis) {
    const auto fixed = std::int32_t(
        std::lround(std::ldexp(signs[axis] * g.mean[i][axis], header.fractional_bits)));
    std::memcpy(row(0) + 3 * axis, &fixed, 3);  // the lowest 24 bits
    row(2)[axis] = std::uint8_t(rounded(g.sh0[i][axis] * kSpzColorSteps + kSpzColorZero, 255));
    row(3)[axis] =
        std::uint8_t(rounded((g.log_scale[i][axis] - kSpzLeastLogScale) * kSpzScaleSteps, 255));
  }
  *row(1) = std::uint8_t(opacity_byte(g.logit_opacity[i]));
  if (header.version == 2) {
    pack_rotation_bytes(g.rotation[i], signs, row(4));
  } else {
    const std::uint32_t rotation = packed_rotation(g.rotation[i], signs);
    std::memcpy(row(4), &rotation, sizeof rotation);
  }
  for (int k = 0; k < sh_rest_count(header.sh_degree); ++k)
    for (int channel = 0; channel < 3; ++channel)
      row(5)[3 * k + channel] =
          packed_sh(sh_step(options, k), sh_sign(k, signs) * g.sh_rest[i].coefficient[k][channel]);
}

// Header and arrays as versions 2 and 3 have them, before gzip.
std::string plain_file(const SpzHeader& header, const Arrays& arrays) {
  std::string bytes;
  append_little(bytes, header);
  for (const std::string& array : arrays) bytes += array;
  return bytes;
}

// Readers count the streams that the SH degree calls for: an empty array has none.
std::string version4_file(SpzHeader header, const Arrays& arrays) {
  std::string table, frames;
  for (const std::string& array : arrays) {
    if (array.empty()) continue;
    const std::string frame = zstd_frame(array);
    append_little(table, SpzStream{frame.size(), array.size()});
    frames += frame;
    ++header.last;
  }
  std::string bytes;
  append_little(bytes, header);
  append_little(bytes, SpzStreamTable{});
  return bytes + table + frames;
}

}  // namespace

std::string spz_bytes(const GaussianModel& model, const SpzOptions& options,
                      const AxisSigns& signs) {
  const Gaussians& g = model.gaussians;
  const int fractional_bits = fractional_bits_for(g);
  GS_CHECK(options.version >= 2 && options.version <= 4 && fractional_bits >= 0);
  GS_CHECK(options.sh_bits >= 0 && options.sh_bits <= 8);
  SpzHeader header;
  header.version = std::uint32_t(options.version);
  header.count = std::uint32_t(g.count());
  header.sh_degree = std::uint8_t(model.sh_degree);
  header.fractional_bits = std::uint8_t(fractional_bits);
  header.flags = model.antialiased ? kSpzAntialiased : 0;
  Arrays arrays;
  const auto row_bytes = spz_row_bytes(header.version, header.sh_degree);
  for (std::size_t s = 0; s < kSpzArrays; ++s) arrays[s].resize(row_bytes[s] * g.count());
  parallel_for(g.count(), 4096,
               [&](std::size_t i) { pack_row(header, options, signs, g, i, arrays); });
  return options.version == 4 ? version4_file(header, arrays) : gzip(plain_file(header, arrays));
}

void write_spz(ByteSink& sink, const GaussianModel& model, const SpzOptions& options) {
  check_positions(model.gaussians, sink.name());
  warn_of_clamped_scales(model.gaussians, sink.name());
  sink.write(spz_bytes(model, options, kHalfTurnX));
}

}  // namespace gs
