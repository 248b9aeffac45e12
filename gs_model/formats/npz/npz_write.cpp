// SPDX-License-Identifier: Apache-2.0
#include <spdlog/fmt/fmt.h>

#include <algorithm>
#include <cmath>
#include <functional>

#include "gs_core/error.h"
#include "gs_core/geometry/symmetric_eigen.h"
#include "gs_core/math/render/activations.h"
#include "gs_core/math/render/covariance.h"
#include "gs_core/math/render/quaternion.h"
#include "gs_core/math/render/rotation.h"
#include "gs_core/threads/parallel.h"
#include "gs_model/edit/select.h"
#include "gs_model/formats/coding/finite_rows.h"
#include "gs_model/formats/coding/half.h"
#include "gs_model/formats/coding/k_means.h"
#include "gs_model/formats/coding/little_endian.h"
#include "gs_model/formats/coding/morton_rows.h"
#include "gs_model/formats/coding/zip_file.h"
#include "gs_model/formats/npz/npy_array.h"
#include "gs_model/formats/npz/npz.h"

namespace gs {
namespace {

constexpr std::size_t kSharedEntries = 4096;  // of a codebook   [c3dgs]
// Rows of more importance keep their own entries [c3dgs], but at most one in so many: of a small
// model nearly all would. A color has 48 bytes, and a shape 7 (docs/lab/2026-11-formats.md).
constexpr float kOwnColor = 0.6e-6f, kOwnShape = 0.3e-5f;
constexpr std::size_t kOwnColors = 16, kOwnShapes = 2;
constexpr float kLeastWeight = 1e-3f;  // of a row without importance, in units of the limit
constexpr float kLogScaleRange = 16;   // Gaussians are at least exp(-this) as large as the largest
constexpr float kLargestHalf = 65504;  // world units

/// The archive in the making.
struct NpzFiles {
  std::vector<ZipEntry> entries;

  void add(const std::string& name, const NpyArray& array) {
    entries.push_back({name + ".npy", npy_bytes(array)});
  }
  template <class T>
  void add(const std::string& name, const char* type, std::vector<std::size_t> shape,
           const std::vector<T>& values) {
    const char* const first = reinterpret_cast<const char*>(values.data());
    add(name, {type, std::move(shape), {first, first + values.size() * sizeof(T)}});
  }
  /// Bytes with a scale and a zero point, over the range of the values and 0.
  void add_quantized(const std::string& name, std::vector<std::size_t> shape,
                     const std::vector<float>& values) {
    float low = 0, high = 0;
    for (const float value : values) low = std::min(low, value), high = std::max(high, value);
    const float scale = high > low ? (high - low) / 255 : 1;
    const auto zero = std::int32_t(-128 - std::lround(low / scale));
    std::vector<std::int8_t> bytes(values.size());
    parallel_for(values.size(), 4096, [&](std::size_t i) {
      bytes[i] = std::int8_t(std::clamp(std::lround(values[i] / scale) + zero, -128l, 127l));
    });
    add(name, "i1", std::move(shape), bytes);
    add(name + "_scale", "f4", {}, std::vector{scale});
    add(name + "_zero_point", "i4", {}, std::vector{zero});
  }
};

/// Points that share 4,096 entries, and some that have one of their own behind these.
struct Codebook {
  std::vector<float> entries;         // (size, dimensions)
  std::vector<std::int32_t> indices;  // (N)
};

Codebook codebook_for(const std::vector<float>& points, std::size_t dimensions,
                      const std::vector<float>& importance, float limit) {
  const std::size_t count = importance.size();
  std::vector<float> shared, weights;
  std::vector<std::uint32_t> own, others;
  for (std::size_t i = 0; i < count; ++i)
    (importance[i] > limit ? own : others).push_back(std::uint32_t(i));
  const auto append_row = [&](std::vector<float>& to, std::uint32_t i) {
    to.insert(to.end(), points.begin() + std::ptrdiff_t(i * dimensions),
              points.begin() + std::ptrdiff_t((i + 1) * dimensions));
  };
  for (const std::uint32_t i : others) {
    append_row(shared, i);
    weights.push_back(kLeastWeight + (limit > 0 ? importance[i] / limit : 0));
  }
  Codebook book{{}, std::vector<std::int32_t>(count)};
  if (others.size() <= kSharedEntries) {
    book.entries = std::move(shared);
    for (std::size_t k = 0; k < others.size(); ++k) book.indices[others[k]] = std::int32_t(k);
  } else {
    Palette palette = palette_of(shared, dimensions, kSharedEntries, weights);
    book.entries = std::move(palette.centroids);
    for (std::size_t k = 0; k < others.size(); ++k)
      book.indices[others[k]] = std::int32_t(palette.labels[k]);
  }
  for (const std::uint32_t i : own) {
    book.indices[i] = std::int32_t(book.entries.size() / dimensions);
    append_row(book.entries, i);
  }
  return book;
}

// The limit that one in `part` exceeds.
float limit_of(const std::vector<float>& importance, std::size_t part) {
  std::vector<float> sorted = importance;
  const auto limit = sorted.begin() + std::ptrdiff_t(sorted.size() / part);
  std::nth_element(sorted.begin(), limit, sorted.end(), std::greater<>());
  return *limit;
}

void add_colors(const GaussianModel& model, const std::vector<float>& importance, float limit,
                NpzFiles& files) {
  const Gaussians& g = model.gaussians;
  const std::size_t rest = std::size_t(sh_rest_count(model.sh_degree)), numbers = 3 * (1 + rest);
  std::vector<float> points(g.count() * numbers);
  for (std::size_t i = 0; i < g.count(); ++i) {
    std::copy_n(&g.sh0[i].x, 3, &points[i * numbers]);
    std::copy_n(&g.sh_rest[i].coefficient[0].x, 3 * rest, points.data() + i * numbers + 3);
  }
  const Codebook book = codebook_for(points, numbers, importance, limit);
  const std::size_t size = book.entries.size() / numbers;
  std::vector<float> sh0, sh_rest;
  for (auto entry = book.entries.begin(); entry != book.entries.end();) {
    sh0.insert(sh0.end(), entry, entry + 3);
    sh_rest.insert(sh_rest.end(), entry + 3, entry + std::ptrdiff_t(numbers));
    entry += std::ptrdiff_t(numbers);
  }
  files.add_quantized("features_dc", {size, 1, 3}, sh0);
  files.add_quantized("features_rest", {size, rest, 3}, sh_rest);
  files.add("feature_indices", "i4", {g.count()}, book.indices);
}

/// A Gaussian's shape apart from its size.
struct ShapeOfSize1 {
  float log_size;      // log of |s|
  Sym3<double> sigma;  // Sigma / |s|^2
};
ShapeOfSize1 shape_of(const Gaussians& g, std::size_t i) {
  const Vec3d log_scale(g.log_scale[i]);
  const double most = std::max({log_scale.x, log_scale.y, log_scale.z});
  const Vec3d squares = variance(log_scale - Vec3d(most));
  const double sum = squares.x + squares.y + squares.z;
  return {float(most + 0.5 * std::log(sum)),
          covariance(rotation_matrix(in_double(g.rotation[i])), squares / sum)};
}

void add_shapes(const Gaussians& g, const std::vector<float>& importance, float limit,
                NpzFiles& files) {
  std::vector<float> points(6 * g.count()), log_sizes(g.count());
  parallel_for(g.count(), 4096, [&](std::size_t i) {
    const ShapeOfSize1 shape = shape_of(g, i);
    const Sym3<double>& s = shape.sigma;
    const double numbers[] = {s.xx, s.xy, s.xz, s.yy, s.yz, s.zz};
    std::copy(numbers, numbers + 6, &points[6 * i]);
    log_sizes[i] = shape.log_size;
  });
  const float largest = *std::max_element(log_sizes.begin(), log_sizes.end());
  for (float& size : log_sizes) size = std::max(size, largest - kLogScaleRange);

  const Codebook book = codebook_for(points, 6, importance, limit);
  const std::size_t size = book.entries.size() / 6;
  std::vector<float> scaling(3 * size), rotation(4 * size);
  parallel_for(size, 4096, [&](std::size_t entry) {
    const float* const s = &book.entries[6 * entry];
    const SymmetricEigen axes = symmetric_eigen({s[0], s[1], s[2], s[3], s[4], s[5]});
    for (int axis = 0; axis < 3; ++axis)
      scaling[3 * entry + std::size_t(axis)] = float(std::sqrt(std::max(axes.value[axis], 0.0)));
    const Quat<double> q = quaternion_of(axes.R);
    const double wxyz[] = {q.w, q.x, q.y, q.z};
    std::copy(wxyz, wxyz + 4, &rotation[4 * entry]);
  });
  files.add_quantized("scaling", {size, 3}, scaling);
  files.add_quantized("rotation", {size, 4}, rotation);
  files.add_quantized("scaling_factor", {g.count(), 1}, log_sizes);
  files.add("gaussian_indices", "i4", {g.count()}, book.indices);
}

void add_means_and_opacities(const std::string& name, const Gaussians& g, NpzFiles& files) {
  std::vector<std::uint16_t> halves(3 * g.count());
  std::vector<float> opacities(g.count());
  for (std::size_t i = 0; i < g.count(); ++i) {
    for (int axis = 0; axis < 3; ++axis) {
      if (std::abs(g.mean[i][axis]) > kLargestHalf)
        throw Error(
            fmt::format("cannot write {}: a Gaussian lies {:.4g} world units from the "
                        "origin, and .npz holds {}; move the model with --recenter or "
                        "--scale, or choose .ply",
                        name, std::abs(g.mean[i][axis]), kLargestHalf));
      halves[3 * i + std::size_t(axis)] = to_half(g.mean[i][axis]);
    }
    opacities[i] = sigmoid(g.logit_opacity[i]);
  }
  files.add("xyz", "f2", {g.count(), 3}, halves);
  files.add_quantized("opacity", {g.count(), 1}, opacities);
}

std::vector<float> ordered(const std::vector<float>& values,
                           const std::vector<std::uint32_t>& order) {
  std::vector<float> result(order.size());
  for (std::size_t i = 0; i < order.size(); ++i) result[i] = values[order[i]];
  return result;
}

}  // namespace

void write_npz(ByteSink& sink, const GaussianModel& unordered, const RowImportance& importance) {
  const std::vector<std::uint32_t> order = morton_order(unordered.gaussians.mean);
  const GaussianModel model = rows_of(unordered, order);
  const Gaussians& g = model.gaussians;
  NpzFiles files;
  files.add("quantization", {"b1", {}, "\x01"});
  files.add("mip_splatting", {"b1", {}, std::string(1, char(model.antialiased))});
  add_means_and_opacities(sink.name(), g, files);
  if (importance.color.empty()) {
    const std::vector<float> coverages = coverages_of(g);
    add_colors(model, coverages, limit_of(coverages, kOwnColors), files);
    add_shapes(g, coverages, limit_of(coverages, kOwnShapes), files);
  } else {
    const std::vector<float> color = ordered(importance.color, order),
                             shape = ordered(importance.shape, order);
    add_colors(model, color, std::max(kOwnColor, limit_of(color, kOwnColors)), files);
    add_shapes(g, shape, std::max(kOwnShape, limit_of(shape, kOwnShapes)), files);
  }
  sink.write(zip_of(files.entries, true));
}

}  // namespace gs
