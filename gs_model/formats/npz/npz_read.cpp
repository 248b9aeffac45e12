// SPDX-License-Identifier: Apache-2.0
#include <spdlog/fmt/fmt.h>

#include <algorithm>
#include <cmath>

#include "gs_core/system/byte_reader.h"
#include "gs_model/formats/coding/count_check.h"
#include "gs_model/formats/coding/finite_rows.h"
#include "gs_model/formats/coding/quantize.h"
#include "gs_model/formats/coding/zip_file.h"
#include "gs_model/formats/npz/npy_array.h"
#include "gs_model/formats/npz/npz.h"

namespace gs {
namespace {

using Path = std::filesystem::path;

constexpr std::size_t kMostBytesEach = 8;      // of a number in an array
constexpr std::size_t kMoreEntries = 1 << 16;  // of a codebook, beyond one for each Gaussian

/// Numbers in rows.
struct NpzTable {
  std::vector<float> values;
  std::size_t rows, columns;
  const float* row(std::size_t i) const { return &values[i * columns]; }
};

/// The arrays of the file. What is missing or of another size is an Error.
class NpzArchive {
 public:
  NpzArchive(const Path& path, std::string_view bytes)
      : path_(path), entries_(packed_entries(path, bytes)) {
    const auto xyz = entries_.find("xyz.npy");
    if (xyz == entries_.end()) fail("lacks the array xyz");
    check_count(path, xyz->second.bytes / (3 * sizeof(std::uint16_t)), bytes.size());
    means_ = table("xyz", xyz->second.bytes / (3 * sizeof(std::uint16_t)));
    if (means_.columns != 3) fail("has no three numbers in each row of xyz");
  }

  const NpzTable& means() const { return means_; }
  bool has(const std::string& name) const { return entries_.contains(name + ".npy"); }
  /// One number, or `otherwise` where there is no such array.
  double number(const std::string& name, double otherwise) const {
    if (!has(name)) return otherwise;
    const NpyArray array = load(name, 1);
    if (array.size() != 1) fail("has more than one number in " + name);
    return array.at(0);
  }
  /// An array with a row for each Gaussian.
  NpzTable of_each(const std::string& name, std::size_t columns) const {
    NpzTable result = table(name, count() * columns);
    if (result.rows != count() || result.columns != columns)
      fail(fmt::format("has no {} numbers for each Gaussian in {}", columns, name));
    return result;
  }
  /// An array with a row for each entry of a codebook.
  NpzTable codebook(const std::string& name, std::size_t most_columns) const {
    NpzTable result = table(name, (count() + kMoreEntries) * most_columns);
    if (result.columns > most_columns) fail("has too many numbers in a row of " + name);
    return result;
  }
  /// (N) entries of a codebook of this size.
  std::vector<std::uint32_t> indices(const std::string& name, std::size_t entries) const {
    std::vector<std::uint32_t> result(count());
    if (!has(name) && entries != count()) fail("lacks the array " + name);
    const NpyArray array = has(name) ? load(name, count()) : NpyArray{};
    if (has(name) && array.size() != count()) fail("has no number for each Gaussian in " + name);
    for (std::size_t i = 0; i < result.size(); ++i) {
      const double index = has(name) ? array.at(i) : double(i);
      if (!(index >= 0 && index < double(entries))) fail("names an entry beyond its codebook");
      result[i] = std::uint32_t(index);
    }
    return result;
  }
  std::size_t count() const { return means_.rows; }
  [[noreturn]] void fail(const std::string& what) const {
    cannot_read(path_, fmt::format("as an .npz of c3dgs it {}; the file is damaged or holds "
                                   "something else, export it again",
                                   what));
  }

 private:
  // Memory is asked for only where the size that the archive names fits.
  NpyArray load(const std::string& name, std::size_t most_numbers) const {
    const auto entry = entries_.find(name + ".npy");
    if (entry == entries_.end()) fail("lacks the array " + name);
    if (entry->second.bytes > kNpyHeaderAtMost + kMostBytesEach * most_numbers)
      fail("has too many numbers in " + name);
    return npy_array(path_, name, unpacked(path_, name, entry->second));
  }
  NpzTable table(const std::string& name, std::size_t most_numbers) const {
    const NpyArray array = load(name, most_numbers);
    const double scale = number(name + "_scale", 1), zero = number(name + "_zero_point", 0);
    NpzTable result{std::vector<float>(array.size()), array.shape.empty() ? 1 : array.shape[0], 0};
    if (result.rows > 0) result.columns = array.size() / result.rows;
    for (std::size_t i = 0; i < array.size(); ++i)
      result.values[i] = float((array.at(i) - zero) * scale);
    return result;
  }

  const Path& path_;
  std::map<std::string, PackedEntry> entries_;
  NpzTable means_;
};

void read_opacities(const NpzArchive& archive, const Gaussians& g) {
  const NpzTable opacity = archive.of_each("opacity", 1);
  const bool are_logits = archive.number("quantization", archive.has("opacity_scale")) == 0;
  // An opacity of 0 or 1 is read as a quarter of a step beside it, so that its logit is finite.
  const double least = 0.25 * std::clamp(archive.number("opacity_scale", 1e-3), 1e-6, 1.0);
  for (std::size_t i = 0; i < g.count(); ++i)
    g.logit_opacity[i] =
        are_logits ? opacity.values[i]
                   : float(logit(std::clamp(double(opacity.values[i]), least, 1 - least)));
}

// Returns the SH degree.
int read_colors(const NpzArchive& archive, const Gaussians& g) {
  const NpzTable sh0 = archive.codebook("features_dc", 3),
                 rest = archive.codebook("features_rest", 3 * kShRestCount);
  const auto degree = sh_degree_with(std::int64_t(rest.columns / 3));
  if (sh0.columns != 3 || rest.columns % 3 != 0 || !degree ||
      (*degree > 0 && rest.rows != sh0.rows))
    archive.fail("has colors that fit no SH degree");
  const std::vector<std::uint32_t> entries = archive.indices("feature_indices", sh0.rows);
  for (std::size_t i = 0; i < g.count(); ++i) {
    std::copy_n(sh0.row(entries[i]), 3, &g.sh0[i].x);
    if (*degree > 0)
      std::copy_n(rest.row(entries[i]), rest.columns, &g.sh_rest[i].coefficient[0].x);
  }
  return *degree;
}

void read_shapes(const NpzArchive& archive, const Gaussians& g) {
  const NpzTable scaling = archive.codebook("scaling", 3),
                 rotation = archive.codebook("rotation", 4);
  if (scaling.columns != 3 || rotation.columns != 4 || scaling.rows != rotation.rows)
    archive.fail("has a codebook of shapes without three scales and a rotation each");
  const bool has_factor = archive.has("scaling_factor");
  const NpzTable factor = has_factor ? archive.of_each("scaling_factor", 1) : NpzTable{};
  const std::vector<std::uint32_t> entries = archive.indices("gaussian_indices", scaling.rows);
  for (std::size_t i = 0; i < g.count(); ++i) {
    Vec3f s;
    std::copy_n(scaling.row(entries[i]), 3, &s.x);
    if (has_factor) {
      s = {std::max(s.x, 0.0f), std::max(s.y, 0.0f), std::max(s.z, 0.0f)};
      const float length = std::sqrt(inner(s, s));
      s = log_of_scale(length > 0 ? s / length : s) + Vec3f(factor.values[i]);
    }
    g.log_scale[i] = s;
    std::copy_n(rotation.row(entries[i]), 4, &g.rotation[i].w);
    normalize(&g.rotation[i].w);
  }
}

}  // namespace

GaussianModel read_npz(const Path& path) {
  ByteReader reader(path);
  const std::size_t size = reader.size();
  const NpzArchive archive(
      path, std::string_view(reinterpret_cast<const char*>(reader.take(size)), size));
  GaussianModel model{Gaussians(archive.count(), host_memory()), 0, false,
                      archive.number("mip_splatting", 0) != 0};
  const Gaussians& g = model.gaussians;
  model.gaussians.sh_rest.fill_zero();
  for (std::size_t i = 0; i < g.count(); ++i) std::copy_n(archive.means().row(i), 3, &g.mean[i].x);
  read_opacities(archive, g);
  model.sh_degree = read_colors(archive, g);
  read_shapes(archive, g);
  return model;
}

}  // namespace gs
