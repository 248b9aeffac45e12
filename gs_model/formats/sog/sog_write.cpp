// SPDX-License-Identifier: Apache-2.0
#include <spdlog/fmt/fmt.h>

#include <algorithm>

#include "gs_core/error.h"
#include "gs_core/system/text/json.h"
#include "gs_core/system/version.h"
#include "gs_core/threads/parallel.h"
#include "gs_model/formats/coding/k_means.h"
#include "gs_model/formats/coding/morton_rows.h"
#include "gs_model/formats/coding/quantize.h"
#include "gs_model/formats/coding/zip_file.h"
#include "gs_model/formats/sog/sog.h"
#include "gs_model/formats/sog/sog_layout.h"
#include "gs_model/formats/sog/webp.h"

namespace gs {
namespace {

constexpr std::uint32_t kMost16 = 65535;

/// The archive in the making.
struct ArchiveFiles {
  Json meta;
  std::vector<ZipEntry> entries;

  void add(const std::string& name, const Image8& picture) {
    entries.push_back({name, webp_of(picture)});
  }
};

/// Pictures of one pixel a Gaussian, row by row; both sides are multiples of 4.
Image8 picture_for(std::size_t count) {
  const auto multiple_of_4 = [](double x) { return 4 * int(std::ceil(x / 4)); };
  const int width = multiple_of_4(std::sqrt(double(count)));
  return Image8(width, multiple_of_4(std::ceil(double(count) / width)), 4, 0);
}
std::uint8_t* pixel(Image8& picture, std::size_t i) { return &picture.pixels[4 * i]; }

void make_opaque(Image8& picture) {
  for (std::size_t i = 3; i < picture.pixels.size(); i += 4) picture.pixels[i] = 255;
}

void add_means(const Gaussians& g, ArchiveFiles& archive) {
  Vec3f low(0), high(0);
  const auto spread = [&](std::size_t i) {
    return Vec3f(sog_log(g.mean[i].x), sog_log(g.mean[i].y), sog_log(g.mean[i].z));
  };
  low = high = spread(0);
  for (std::size_t i = 1; i < g.count(); ++i)
    for (int axis = 0; axis < 3; ++axis) {
      low[axis] = std::min(low[axis], spread(i)[axis]);
      high[axis] = std::max(high[axis], spread(i)[axis]);
    }
  Image8 lower = picture_for(g.count()), upper = lower;
  parallel_for(g.count(), 4096, [&](std::size_t i) {
    for (int axis = 0; axis < 3; ++axis) {
      const float width = high[axis] - low[axis];
      const float fraction = width > 0 ? (spread(i)[axis] - low[axis]) / width : 0;
      const std::uint32_t word = rounded(fraction * float(kMost16), kMost16);
      pixel(lower, i)[axis] = std::uint8_t(word & 255);
      pixel(upper, i)[axis] = std::uint8_t(word >> 8);
    }
  });
  make_opaque(lower);
  make_opaque(upper);
  archive.add("means_l.webp", lower);
  archive.add("means_u.webp", upper);
  archive.meta["means"] = {{"mins", {low.x, low.y, low.z}},
                           {"maxs", {high.x, high.y, high.z}},
                           {"files", {"means_l.webp", "means_u.webp"}}};
}

void add_rotations(const Gaussians& g, ArchiveFiles& archive) {
  Image8 picture = picture_for(g.count());
  parallel_for(g.count(), 4096, [&](std::size_t i) {
    const Quatf& q = g.rotation[i];
    const SmallestThree parts = smallest_three({q.w, q.x, q.y, q.z});
    for (int k = 0; k < 3; ++k)
      pixel(picture, i)[k] = std::uint8_t(to_unorm(parts.others[k] * kSqrtHalf + 0.5f, 8));
    pixel(picture, i)[3] = std::uint8_t(kSogRotationTag + parts.largest);
  });
  archive.add("quats.webp", picture);
  archive.meta["quats"] = {{"files", Json::array({"quats.webp"})}};
}

// A picture of indices into a codebook of all numbers of `rows`; `alpha` of each Gaussian.
template <class Alpha>
void add_coded(const std::string& name, const Buffer<Vec3f>& rows, Alpha&& alpha,
               ArchiveFiles& archive) {
  const float* numbers = &rows[0].x;
  const std::vector<float> book =
      codebook_of(std::vector<float>(numbers, numbers + 3 * rows.size()), kSogCodebook);
  Image8 picture = picture_for(rows.size());
  parallel_for(rows.size(), 4096, [&](std::size_t i) {
    for (int k = 0; k < 3; ++k)
      pixel(picture, i)[k] = std::uint8_t(nearest_entry(book, rows[i][k]));
    pixel(picture, i)[3] = alpha(i);
  });
  archive.add(name + ".webp", picture);
  archive.meta[name] = {{"codebook", book}, {"files", Json::array({name + ".webp"})}};
}

// The palette's size, as other writers choose it: a power of two, at most two entries for each
// Gaussian, 65,536 at most.
std::size_t palette_size(std::size_t count) {
  std::size_t size = 1;
  while (2 * size <= count && size < kSogLargestPalette) size *= 2;
  return size;
}

void add_sh(const GaussianModel& model, ArchiveFiles& archive) {
  const Gaussians& g = model.gaussians;
  const std::size_t rest = std::size_t(sh_rest_count(model.sh_degree)), dimensions = 3 * rest;
  std::vector<float> points(g.count() * dimensions);
  for (std::size_t i = 0; i < g.count(); ++i)
    std::copy_n(&g.sh_rest[i].coefficient[0].x, dimensions, &points[i * dimensions]);
  const Palette palette = palette_of(points, dimensions, palette_size(g.count()));
  const std::vector<float> book = codebook_of(palette.centroids, kSogCodebook);

  const std::size_t size = palette.centroids.size() / dimensions;
  Image8 centroids(int(kSogPaletteColumns * rest),
                   int((size + kSogPaletteColumns - 1) / kSogPaletteColumns), 4, 0);
  for (std::size_t entry = 0; entry < size; ++entry)
    for (std::size_t k = 0; k < rest; ++k)
      for (std::size_t channel = 0; channel < 3; ++channel)
        pixel(centroids, entry * rest + k)[channel] = std::uint8_t(
            nearest_entry(book, palette.centroids[entry * dimensions + 3 * k + channel]));
  Image8 labels = picture_for(g.count());
  for (std::size_t i = 0; i < g.count(); ++i) {
    pixel(labels, i)[0] = std::uint8_t(palette.labels[i] & 255);
    pixel(labels, i)[1] = std::uint8_t(palette.labels[i] >> 8);
  }
  make_opaque(centroids);
  make_opaque(labels);
  archive.add("shN_centroids.webp", centroids);
  archive.add("shN_labels.webp", labels);
  archive.meta["shN"] = {{"count", size},
                         {"bands", model.sh_degree},
                         {"codebook", book},
                         {"files", {"shN_centroids.webp", "shN_labels.webp"}}};
}

void check_count(const std::string& name, std::size_t count) {
  if (count > std::size_t(kWebpLargestSide) * (kWebpLargestSide - 4))  // sides are multiples of 4
    throw Error(fmt::format(
        "cannot write {}: {} Gaussians do not fit into pictures of {} pixels a side; choose .ply",
        name, count, kWebpLargestSide));
}

// meta.json and the pictures, rows in their order.
std::vector<ZipEntry> entries_of(const GaussianModel& model) {
  const Gaussians& g = model.gaussians;
  ArchiveFiles archive;
  archive.meta = {{"version", kSogVersion},
                  {"asset", {{"generator", fmt::format("gemsplat {}", kVersion)}}},
                  {"count", g.count()}};
  if (model.antialiased) archive.meta["model"] = "antialiased";
  add_means(g, archive);
  add_rotations(g, archive);
  add_coded(
      "scales", g.log_scale, [](std::size_t) { return std::uint8_t(255); }, archive);
  add_coded(
      "sh0", g.sh0, [&](std::size_t i) { return std::uint8_t(opacity_byte(g.logit_opacity[i])); },
      archive);
  if (model.sh_degree > 0) add_sh(model, archive);
  archive.entries.push_back({"meta.json", archive.meta.dump()});
  return std::move(archive.entries);
}

}  // namespace

void write_sog(ByteSink& sink, const GaussianModel& model) {
  check_count(sink.name(), model.gaussians.count());
  sink.write(zip_of(entries_of(in_morton_order(model))));
}

}  // namespace gs
