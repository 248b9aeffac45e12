// SPDX-License-Identifier: Apache-2.0
#include <spdlog/fmt/fmt.h>

#include <algorithm>
#include <cmath>

#include "gs_core/error.h"
#include "gs_core/system/text/json.h"
#include "gs_core/system/version.h"
#include "gs_core/threads/parallel.h"
#include "gs_model/formats/coding/compression.h"
#include "gs_model/formats/coding/little_endian.h"
#include "gs_model/formats/coding/quantize.h"
#include "gs_model/formats/lod/rad.h"
#include "gs_model/formats/lod/rad_layout.h"
#include "gs_model/formats/lod/rad_values.h"
#include "gs_model/lod/splat_tree.h"

namespace gs {
namespace {

constexpr double kOutliers = 0.001;      // share of the values that may lie beyond a range of bytes
constexpr std::size_t kFirstChunk = 64;  // the first of several chunks has 1/64 of the tree

void pad(std::string& bytes) { bytes.append(rad_padding(bytes.size()), '\0'); }

// Magic, JSON, and zeros behind both.
std::string head_of(std::uint32_t magic, const Json& json) {
  const std::string text = json.dump();
  std::string head;
  append_little(head, magic);
  append_little(head, std::uint32_t(text.size()));
  head += text;
  pad(head);
  return head;
}

// The value below which this share of the values lies.
float quantile(std::vector<float> values, double share) {
  const auto at = values.begin() + std::ptrdiff_t(share * double(values.size() - 1));
  std::nth_element(values.begin(), at, values.end());
  return *at;
}

/// Which Gaussians of a tree each chunk has, and their numbers in the file. Where there are several
/// chunks, the first one is short, so that a viewer has a picture of the whole model soon. The
/// numbers of chunk k begin at k * kRadChunk nevertheless, as viewers expect.
class Chunks {
 public:
  explicit Chunks(const SplatTree& tree) : count_(tree.child_count.size()) {
    if (count_ <= kRadChunk) {
      first_ = count_;
      return;
    }
    // It ends between two families, whose numbers have no gap.
    for (std::size_t i = 0; i < count_; ++i)
      if (tree.child_count[i] > 0 && tree.child_start[i] >= count_ / kFirstChunk)
        first_ = std::min<std::size_t>(first_, tree.child_start[i]);
  }

  std::size_t size() const { return 1 + (count_ - first_ + kRadChunk - 1) / kRadChunk; }
  std::size_t begin(std::size_t k) const { return k == 0 ? 0 : end(k - 1); }
  std::size_t end(std::size_t k) const { return std::min(count_, first_ + k * kRadChunk); }
  std::size_t number_of(std::size_t row) const {
    return row < first_ ? row : row - first_ + kRadChunk;
  }

 private:
  std::size_t count_, first_ = kRadChunk;
};

/// Chunk k.
class Chunk {
 public:
  Chunk(const SplatTree& tree, int sh_degree, const Json& encoding, const Chunks& chunks,
        std::size_t k)
      : tree_(tree), g_(tree.gaussians), chunks_(chunks), begin_(chunks.begin(k)),
        end_(chunks.end(k)) {
    add("center", "f32_lebytes", f32_lebytes(vectors(g_.mean, [](float x) { return x; }), 3));
    add("alpha", "f16",
        f16_planes(
            values(1, [&](std::size_t i, float* to) { to[0] = sigmoid(g_.logit_opacity[i]); }), 1));
    add("rgb", "f16", f16_planes(vectors(g_.sh0, color_of_sh0), 3));
    add("scales", "ln_f16", f16_planes(vectors(g_.log_scale, [](float s) { return s; }), 3));
    std::string rotations;
    for (std::size_t i = begin_; i < end_; ++i) append_oct88r8(rotations, g_.rotation[i]);
    add("orientation", "oct88r8", rotations);
    for (int band = 0; band < sh_degree; ++band) add_sh(kRadBands[band]);
    add_children();
    json_ = {{"version", 1},
             {"base", k * kRadChunk},
             {"count", end_ - begin_},
             {"payloadBytes", payload_.size()},
             {"maxSh", sh_degree},
             {"lodTree", true},
             {"splatEncoding", encoding},
             {"properties", properties_}};
  }

  std::string bytes() const {
    std::string bytes = head_of(kRadChunkMagic, json_);
    append_little(bytes, std::uint64_t(payload_.size()));
    return bytes + payload_;
  }

 private:
  // (rows, numbers): f(row, to) writes those of a row.
  template <class F>
  std::vector<float> values(std::size_t numbers, F&& f) const {
    std::vector<float> result((end_ - begin_) * numbers);
    for (std::size_t i = begin_; i < end_; ++i) f(i, &result[(i - begin_) * numbers]);
    return result;
  }
  template <class F>
  std::vector<float> vectors(const Buffer<Vec3f>& array, F&& f) const {
    return values(3, [&](std::size_t i, float* to) {
      for (int axis = 0; axis < 3; ++axis) to[axis] = f(array[i][axis]);
    });
  }
  void add(const char* property, const char* encoding, const std::string& raw, float max = 0) {
    const std::string packed = deflate_raw(raw);
    Json json = {{"offset", payload_.size()},
                 {"bytes", packed.size()},
                 {"property", property},
                 {"encoding", encoding},
                 {"compression", "gz"}};
    if (max > 0) {
      json["min"] = -max;
      json["max"] = max;
    }
    properties_.push_back(std::move(json));
    payload_ += packed;
    pad(payload_);
  }
  void add_sh(const RadBand& band) {
    const auto numbers = std::size_t(3 * band.coefficients);
    const std::vector<float> sh = values(numbers, [&](std::size_t i, float* to) {
      std::copy_n(&g_.sh_rest[i].coefficient[band.first].x, numbers, to);
    });
    float max = 1e-6f;
    for (const float value : sh) max = std::max(max, std::abs(value));
    add(band.property, "s8", s8_planes(sh, numbers, max), max);
  }
  void add_children() {
    std::string counts, starts;
    for (std::size_t i = begin_; i < end_; ++i) {
      append_little(counts, std::uint16_t(tree_.child_count[i]));
      append_little(starts, std::uint32_t(chunks_.number_of(tree_.child_start[i])));
    }
    add("child_count", "u16", counts);
    add("child_start", "u32", starts);
  }

  const SplatTree& tree_;
  const Gaussians& g_;
  const Chunks& chunks_;
  std::size_t begin_, end_;
  Json properties_ = Json::array(), json_;
  std::string payload_;
};

// Ranges for viewers that keep colors, logarithms of scales and SH in bytes. No large Gaussian is
// made smaller.
Json splat_encoding(const Gaussians& g, int sh_degree) {
  const auto all = [](const auto& array, std::size_t numbers, std::size_t first) {
    std::vector<float> values;
    for (std::size_t i = 0; i < array.size(); ++i) {
      const float* row = reinterpret_cast<const float*>(&array[i]) + first;
      values.insert(values.end(), row, row + numbers);
    }
    return values;
  };
  const std::vector<float> sh0 = all(g.sh0, 3, 0), scales = all(g.log_scale, 3, 0);
  Json json = {{"rgbMin", std::min(0.0f, color_of_sh0(quantile(sh0, kOutliers)))},
               {"rgbMax", std::max(1.0f, color_of_sh0(quantile(sh0, 1 - kOutliers)))},
               {"lnScaleMin", quantile(scales, 10 * kOutliers)},
               {"lnScaleMax", quantile(scales, 1) + 1e-3f},
               {"sh1Max", 1},
               {"sh2Max", 1},
               {"sh3Max", 1},
               {"lodOpacity", true}};
  for (int band = 0; band < sh_degree; ++band) {
    const auto [property, first, coefficients] = kRadBands[band];
    std::vector<float> sh = all(g.sh_rest, std::size_t(3 * coefficients), std::size_t(3 * first));
    for (float& value : sh) value = std::abs(value);
    json[std::string(property) + "Max"] = std::max(1e-6f, quantile(std::move(sh), 1 - kOutliers));
  }
  return json;
}

}  // namespace

void write_rad(ByteSink& sink, const GaussianModel& model) {
  const SplatTree tree = splat_tree_of(build_lod_tree(copy_of(model.gaussians)));
  const std::size_t count = tree.gaussians.count();
  // Merging a leaf of 50,000 cannot give more children.
  GS_CHECK(*std::max_element(tree.child_count.begin(), tree.child_count.end()) < 65536);
  const Json encoding = splat_encoding(tree.gaussians, model.sh_degree);
  const Chunks parts(tree);
  std::vector<std::string> chunks(parts.size());
  parallel_for(chunks.size(), 1, [&](std::size_t k) {
    chunks[k] = Chunk(tree, model.sh_degree, encoding, parts, k).bytes();
  });
  Json ranges = Json::array();
  std::size_t offset = 0;
  for (const std::string& chunk : chunks) {
    ranges.push_back({{"offset", offset}, {"bytes", chunk.size()}});
    offset += chunk.size();
  }
  sink.write(
      head_of(kRadMagic, {{"version", 1},
                          {"type", "gsplat"},
                          {"count", parts.number_of(count - 1) + 1},
                          {"maxSh", model.sh_degree},
                          {"lodTree", true},
                          {"chunkSize", kRadChunk},
                          {"allChunkBytes", offset},
                          {"chunks", ranges},
                          {"splatEncoding", encoding},
                          {"comment", fmt::format("gemsplat {}{}", kVersion,
                                                  model.antialiased ? " antialiased" : "")}}));
  for (const std::string& chunk : chunks) sink.write(chunk);
}

}  // namespace gs
