// SPDX-License-Identifier: Apache-2.0
#include <algorithm>
#include <cmath>
#include <limits>
#include <numeric>

#include "gs_core/error.h"
#include "gs_core/threads/parallel.h"
#include "gs_model/edit/model_moment.h"
#include "gs_model/formats/coding/little_endian.h"
#include "gs_model/formats/coding/morton_rows.h"
#include "gs_model/formats/coding/quantize.h"
#include "gs_model/formats/gs4d/gs4d.h"
#include "gs_model/formats/gs4d/gs4d_layout.h"
#include "gs_model/formats/gs4d/moving_gaussian.h"

namespace gs {
namespace {

// Limits of what is written, far beyond any scene: ranges and their steps stay finite.
constexpr double kMostWrittenUnits = 1e18, kMostWrittenLog = 60;

/// A Gaussian as the file holds it, before it is rounded.
struct Row {
  Vec3f mean, drift, log_scale;
  float time_mean, log_time_scale, opacity;
  std::uint32_t rotation;
  std::uint32_t source;  // row of the model, for its color
};

float within(double value, double most) { return float(std::clamp(value, -most, most)); }
Vec3f within(const Vec3d& value, double most) {
  return {within(value.x, most), within(value.y, most), within(value.z, most)};
}

std::uint32_t packed_rotation(const Quat<double>& q) {
  const SmallestThree parts = smallest_three({float(q.w), float(q.x), float(q.y), float(q.z)});
  std::uint32_t word = std::uint32_t(parts.largest) << 30;
  for (int i = 0; i < 3; ++i) {
    const long steps = std::lround(parts.others[i] / kSqrtHalf * kGs4dRotationSteps);
    word |=
        (std::uint32_t(std::clamp<long>(steps, -kGs4dRotationSteps, kGs4dRotationSteps)) & 1023u)
        << 10 * i;
  }
  return word;
}

Row row_of(const Gaussians& g, std::uint32_t i) {
  SpacetimeShape<double> shape = spacetime_shape_of(g, i);
  const bool is_drawn = !is_degenerate(shape.rotations);
  if (!is_drawn) shape.rotations = {{1, 0, 0, 0}, {1, 0, 0, 0}};
  for (int k = 0; k < 3; ++k)
    shape.log_scale[k] = std::clamp(shape.log_scale[k], -kMostWrittenLog, kMostWrittenLog);
  shape.log_time_scale = std::clamp(shape.log_time_scale, -kMostWrittenLog, kMostWrittenLog);
  const MovingGaussian moving = moving_gaussian(shape);
  return {within(moving.mean, kMostWrittenUnits),
          within(moving.drift, kMostWrittenUnits),
          within(moving.log_scale, kMostWrittenLog),
          within(moving.time_mean, kMostWrittenUnits),
          within(moving.log_time_scale, kMostWrittenLog),
          is_drawn ? sigmoid(g.logit_opacity[i]) : 0.0f,
          packed_rotation(moving.rotation),
          i};
}

/// The times, cut to 0..1, between which a Gaussian is drawn; first > last if it never is.
struct Life {
  double first, last;
};
Life life_of(double time_mean, double log_time_scale) {
  const double reach = std::sqrt(-2 * std::log(double(kMinMarginal))) * std::exp(log_time_scale);
  return {std::max(0.0, time_mean - reach), std::min(1.0, time_mean + reach)};
}

/// Rows in the order of the file: by the first time at which they are drawn, and in each chunk in
/// the order of `rows`, in which neighbors are near each other.
std::vector<Row> in_order_of_time(const std::vector<Row>& rows) {
  std::vector<double> first(rows.size());
  for (std::size_t i = 0; i < rows.size(); ++i) {
    const Life life = life_of(rows[i].time_mean, rows[i].log_time_scale);
    first[i] = life.first <= life.last ? life.first : double(kGs4dNever);
  }
  std::vector<std::uint32_t> order(rows.size());
  std::iota(order.begin(), order.end(), 0u);
  std::stable_sort(order.begin(), order.end(),
                   [&](std::uint32_t a, std::uint32_t b) { return first[a] < first[b]; });
  for (std::size_t at = 0; at < order.size(); at += kGs4dChunk)
    std::sort(order.begin() + std::ptrdiff_t(at),
              order.begin() + std::ptrdiff_t(std::min(at + kGs4dChunk, order.size())));
  std::vector<Row> result;
  result.reserve(rows.size());
  for (const std::uint32_t i : order) result.push_back(rows[i]);
  return result;
}

class Extent {
 public:
  void add(double value) {
    low_ = std::min(low_, value);
    high_ = std::max(high_, value);
  }
  Gs4dRange range(int most) const { return {float(low_), float((high_ - low_) / most)}; }
  float step_from_zero(int most) const {
    return float(std::max(std::abs(low_), std::abs(high_)) / most);
  }

 private:
  double low_ = std::numeric_limits<double>::infinity(), high_ = -low_;
};

constexpr int kMost8 = 255, kMost16 = 65535, kMostSigned8 = 127, kMostSigned16 = 32767;

std::uint32_t steps(const Gs4dRange& range, float value, std::uint32_t most) {
  return range.step > 0 ? rounded((value - range.low) / range.step, most) : 0;
}
int signed_steps(float step, float value, int most) {
  return step > 0 ? int(std::clamp(std::lround(double(value) / step), -long(most), long(most))) : 0;
}

class ChunkWriter {
 public:
  ChunkWriter(const GaussianModel& model, const Row* rows, std::size_t count)
      : model_(model), rows_(rows), count_(count), at_(count, model.sh_degree),
        bytes_(at_.end, '\0') {}

  std::string write(Gs4dChunk& entry) {
    entry = {std::uint32_t(count_), std::uint32_t(at_.end)};
    for (std::size_t begin = 0; begin < count_; begin += kGs4dBlock) {
      const std::size_t end = std::min(begin + kGs4dBlock, count_);
      const Gs4dBlock block = block_of(begin, end);
      std::memcpy(bytes_.data() + begin / kGs4dBlock * sizeof block, &block, sizeof block);
      for (std::size_t i = begin; i < end; ++i) write_row(block, i, entry);
    }
    return std::move(bytes_);
  }

 private:
  template <class T>
  void put(std::size_t at, const T& value) {
    std::memcpy(bytes_.data() + at, &value, sizeof value);
  }

  Gs4dBlock block_of(std::size_t begin, std::size_t end) const {
    Extent position[3], drift[3], time_mean, log_time_scale, log_scale, sh0, sh;
    for (std::size_t i = begin; i < end; ++i) {
      const Row& row = rows_[i];
      time_mean.add(row.time_mean);
      log_time_scale.add(row.log_time_scale);
      for (int k = 0; k < 3; ++k) {
        position[k].add(row.mean[k]);
        drift[k].add(row.drift[k]);
        log_scale.add(row.log_scale[k]);
        sh0.add(within(model_.gaussians.sh0[row.source][k], kMostWrittenUnits));
        for (int c = 0; c < sh_rest_count(model_.sh_degree); ++c)
          sh.add(within(model_.gaussians.sh_rest[row.source].coefficient[c][k], kMostWrittenUnits));
      }
    }
    Gs4dBlock block{};
    for (int k = 0; k < 3; ++k) {
      const Gs4dRange range = position[k].range(kMost16);
      block.position_low[k] = range.low;
      block.position_step[k] = range.step;
      block.drift_step[k] = drift[k].step_from_zero(kMostSigned16);
    }
    block.time_mean = time_mean.range(kMost16);
    block.log_time_scale = log_time_scale.range(kMost16);
    block.log_scale = log_scale.range(kMost8);
    block.sh0 = sh0.range(kMost8);
    block.sh_step = model_.sh_degree > 0 ? sh.step_from_zero(kMostSigned8) : 0;
    return block;
  }

  void write_row(const Gs4dBlock& block, std::size_t i, Gs4dChunk& entry) {
    const Row& row = rows_[i];
    put(at_.rotations + 4 * i, row.rotation);
    for (int k = 0; k < 3; ++k) {
      const Gs4dRange place{block.position_low[k], block.position_step[k]};
      put(at_.positions + 6 * i + 2 * k, std::uint16_t(steps(place, row.mean[k], kMost16)));
      put(at_.drifts + 6 * i + 2 * k,
          std::int16_t(signed_steps(block.drift_step[k], row.drift[k], kMostSigned16)));
      put(at_.scales + 3 * i + k, std::uint8_t(steps(block.log_scale, row.log_scale[k], kMost8)));
      put(at_.colors + 3 * i + k,
          std::uint8_t(steps(block.sh0, model_.gaussians.sh0[row.source][k], kMost8)));
    }
    const std::uint32_t mean = steps(block.time_mean, row.time_mean, kMost16);
    const std::uint32_t scale = steps(block.log_time_scale, row.log_time_scale, kMost16);
    put(at_.times + 4 * i, std::uint16_t(mean));
    put(at_.times + 4 * i + 2, std::uint16_t(scale));
    put(at_.opacities + i, std::uint8_t(to_unorm(row.opacity, 8)));
    const int rest = sh_rest_count(model_.sh_degree);
    for (int c = 0; c < rest; ++c)
      for (int k = 0; k < 3; ++k)
        put(at_.sh + std::size_t(3 * (std::ptrdiff_t(i) * rest + c) + k),
            std::int8_t(signed_steps(block.sh_step,
                                     model_.gaussians.sh_rest[row.source].coefficient[c][k],
                                     kMostSigned8)));
    // as readers see it
    lengthen(entry, life_of(block.time_mean.value(mean), block.log_time_scale.value(scale)));
  }

  static void lengthen(Gs4dChunk& entry, const Life& life) {
    if (life.first > life.last) return;
    const bool is_first = entry.begin == kGs4dNever;
    entry.begin = is_first ? float(life.first) : std::min(entry.begin, float(life.first));
    entry.end = is_first ? float(life.last) : std::max(entry.end, float(life.last));
  }

  const GaussianModel& model_;
  const Row* rows_;
  std::size_t count_;
  Gs4dArrays at_;
  std::string bytes_;
};

}  // namespace

void write_gs4d(ByteSink& sink, const GaussianModel& unordered, double duration) {
  GS_CHECK(unordered.gaussians.has_time);
  const GaussianModel model = in_morton_order(unordered);
  std::vector<Row> rows(model.gaussians.count());
  parallel_for(rows.size(), 1024,
               [&](std::size_t i) { rows[i] = row_of(model.gaussians, std::uint32_t(i)); });
  rows = in_order_of_time(rows);

  std::vector<Gs4dChunk> table((rows.size() + kGs4dChunk - 1) / kGs4dChunk);
  std::vector<std::string> chunks(table.size());
  parallel_for(chunks.size(), 1, [&](std::size_t c) {
    const std::size_t begin = c * kGs4dChunk;
    chunks[c] = ChunkWriter(model, rows.data() + begin, std::min(kGs4dChunk, rows.size() - begin))
                    .write(table[c]);
  });
  Gs4dHeader header;
  header.count = std::uint32_t(rows.size());
  header.chunks = std::uint32_t(table.size());
  header.sh_degree = std::uint8_t(model.sh_degree);
  header.flags = model.antialiased ? kGs4dAntialiased : 0;
  header.duration = float(duration);
  sink.write(&header, sizeof header);
  sink.write(table.data(), table.size() * sizeof(Gs4dChunk));
  for (const std::string& chunk : chunks) sink.write(chunk);
}

}  // namespace gs
