// SPDX-License-Identifier: Apache-2.0
#include "gs_model/formats/npz/vectree.h"

#include <spdlog/fmt/fmt.h>

#include <algorithm>
#include <bit>
#include <numeric>

#include "gs_core/system/byte_reader.h"
#include "gs_model/edit/select.h"
#include "gs_model/formats/coding/count_check.h"
#include "gs_model/formats/coding/finite_rows.h"
#include "gs_model/formats/coding/half.h"
#include "gs_model/formats/coding/k_means.h"
#include "gs_model/formats/coding/little_endian.h"
#include "gs_model/formats/coding/zip_file.h"
#include "gs_model/formats/npz/npy_array.h"

namespace gs {
namespace {

using Path = std::filesystem::path;

constexpr std::string_view kVectreeFolder = "extreme_saving/";
constexpr std::size_t kPaletteColors = 8192;  // [LightGaussian]
constexpr double kOwnShare = 0.4;             // of the Gaussians have their own color, too
constexpr std::size_t kColorColumns = 3 + 3 * kShRestCount, kShapeColumns = 8;
constexpr std::size_t kMostColors = 1 << 20;  // of a palette that is read
constexpr std::size_t kSmallFile = 1 << 16;   // bytes; others are no larger than the archive
constexpr float kLeastColorWeight = 1e-3f;    // of a Gaussian, in units of the largest

/// The archive of archives. What is missing or of another size is an Error.
class VectreeFiles {
 public:
  VectreeFiles(const Path& path, std::string_view bytes)
      : path_(path), most_(kSmallFile + 4 * bytes.size()) {
    for (const auto& [name, entry] : packed_entries(path, bytes))
      files_.emplace(Path(name).filename().string(), entry);
  }

  /// The one array of NAME.npz, with at most so many numbers.
  NpyArray load(const std::string& name, std::size_t most_numbers) const {
    const auto file = files_.find(name + ".npz");
    if (file == files_.end()) fail("lacks " + name + ".npz");
    if (file->second.bytes > most_) fail("is larger than its archive in " + name);
    const std::string npz = unpacked(path_, name, file->second);
    const std::map<std::string, PackedEntry> arrays = packed_entries(path_, npz);
    const auto array = arrays.find("arr_0.npy");
    if (array == arrays.end()) fail("lacks arr_0 in " + name);
    if (array->second.bytes > kNpyHeaderAtMost + sizeof(double) * most_numbers)
      fail("has too many numbers in " + name);
    return npy_array(path_, name, unpacked(path_, name, array->second));
  }
  /// The same with so many numbers.
  NpyArray exactly(const std::string& name, std::size_t numbers) const {
    NpyArray array = load(name, numbers);
    if (array.size() != numbers) fail(fmt::format("has no {} numbers in {}", numbers, name));
    return array;
  }
  /// At least so many bits, from the highest of each byte on.
  std::vector<bool> bits(const std::string& name, std::size_t count) const {
    const NpyArray bytes = load(name, (count + 7) / 8);
    if (bytes.type[1] != '1' || 8 * bytes.size() < count)
      fail(fmt::format("has no {} bits in {}", count, name));
    std::vector<bool> result(count);
    for (std::size_t i = 0; i < count; ++i)
      result[i] = (std::uint8_t(bytes.bytes[i / 8]) >> (7 - i % 8)) & 1;
    return result;
  }
  [[noreturn]] void fail(const std::string& what) const {
    cannot_read(path_, fmt::format("as an extreme_saving.zip of LightGaussian it {}; the file is "
                                   "damaged or holds something else, export it again",
                                   what));
  }

 private:
  const Path& path_;
  std::size_t most_;  // bytes of a file in the archive
  std::map<std::string, PackedEntry> files_;
};

/// One Gaussian's color of a table, whose SH coefficients are sorted by channel.
void take_color(const NpyArray& table, std::size_t row, std::size_t columns, const Gaussians& g,
                std::size_t i) {
  const std::size_t rest = columns / 3 - 1;
  const auto number = [&](std::size_t k) { return float(table.at(row * columns + k)); };
  for (int c = 0; c < 3; ++c) {
    g.sh0[i][c] = number(std::size_t(c));
    for (std::size_t k = 0; k < rest; ++k)
      g.sh_rest[i].coefficient[k][c] = number(3 + std::size_t(c) * rest + k);
  }
}

// Returns the SH degree.
int take_colors(const VectreeFiles& files, const Gaussians& g) {
  const std::size_t count = g.count();
  const NpyArray palette = files.load("codebook", kMostColors * kColorColumns);
  const std::size_t colors = palette.shape.empty() ? 0 : palette.shape[0];
  const std::size_t columns = colors > 0 ? palette.size() / colors : 0;
  const auto degree = columns % 3 ? std::nullopt : sh_degree_with(std::int64_t(columns / 3) - 1);
  if (columns == 0 || !degree) files.fail("has colors that fit no SH degree");
  const std::vector<bool> has_own = files.bits("non_vq_mask", count);
  const auto own = std::size_t(std::count(has_own.begin(), has_own.end(), true));
  const NpyArray own_colors = files.exactly("non_vq_feats", own * columns);
  const auto width = std::size_t(std::bit_width(colors) - 1);  // bits of an index
  const std::vector<bool> bits = files.bits("vq_indexs", (count - own) * width);
  for (std::size_t i = 0, next_own = 0, next_bit = 0; i < count; ++i) {
    if (has_own[i]) {
      take_color(own_colors, next_own++, columns, g, i);
      continue;
    }
    std::size_t color = 0;  // below 2^width, and so below `colors`
    for (std::size_t bit = 0; bit < width; ++bit) color = 2 * color + bits[next_bit++];
    take_color(palette, color, columns, g, i);
  }
  return *degree;
}

/// A file of the archive with one array, called `array_name`.
ZipEntry packed_array(const std::string& name, const char* array_name, const NpyArray& array) {
  return {std::string(kVectreeFolder) + name + ".npz",
          zip_of({{std::string(array_name) + ".npy", npy_bytes(array)}}, true)};
}
template <class T>
ZipEntry vectree_file(const std::string& name, const char* type, std::vector<std::size_t> shape,
                      const std::vector<T>& values) {
  const char* const first = reinterpret_cast<const char*>(values.data());
  return packed_array(name, "arr_0",
                      {type, std::move(shape), {first, first + values.size() * sizeof(T)}});
}

std::vector<std::uint16_t> halves_of(const std::vector<float>& values) {
  std::vector<std::uint16_t> halves(values.size());
  std::transform(values.begin(), values.end(), halves.begin(), to_half);
  return halves;
}

std::vector<std::uint8_t> packed_bits(const std::vector<bool>& bits) {
  std::vector<std::uint8_t> bytes((bits.size() + 7) / 8);
  for (std::size_t i = 0; i < bits.size(); ++i)
    bytes[i / 8] = std::uint8_t(bytes[i / 8] | (bits[i] << (7 - i % 8)));
  return bytes;
}

// An array that is a Python dict, by the protocol of pickle: numpy.array({...}, "O").
ZipEntry metadata_file(const std::vector<std::pair<std::string, std::size_t>>& numbers) {
  std::string pickle =
      "\x80\x02"
      "cnumpy\narray\n}(";
  const auto add_text = [&](const std::string& text) {
    pickle += 'X';
    append_little(pickle, std::uint32_t(text.size()));
    pickle += text;
  };
  for (const auto& [name, number] : numbers) {
    add_text(name);
    pickle += 'J';
    append_little(pickle, std::int32_t(number));
  }
  pickle += 'u';
  add_text("O");
  pickle += "\x86R.";
  return packed_array("metadata", "metadata", {"O", {}, pickle});
}

/// (N, columns) as the archive has them.
std::vector<float> colors_of(const GaussianModel& model, std::size_t columns) {
  const Gaussians& g = model.gaussians;
  const std::size_t rest = columns / 3 - 1;
  std::vector<float> colors(g.count() * columns);
  for (std::size_t i = 0; i < g.count(); ++i) {
    float* const row = &colors[i * columns];
    for (std::size_t c = 0; c < 3; ++c) {
      row[c] = g.sh0[i][int(c)];
      for (std::size_t k = 0; k < rest; ++k)
        row[3 + c * rest + k] = g.sh_rest[i].coefficient[k][int(c)];
    }
  }
  return colors;
}

/// Whether a Gaussian is among those of the largest weights that keep their colors.
std::vector<bool> owners(const std::vector<float>& weights) {
  std::vector<std::uint32_t> order(weights.size());
  std::iota(order.begin(), order.end(), 0u);
  std::stable_sort(order.begin(), order.end(),
                   [&](std::uint32_t a, std::uint32_t b) { return weights[a] > weights[b]; });
  std::vector<bool> result(weights.size());
  const auto own = std::size_t(kOwnShare * double(weights.size()));
  for (std::size_t k = 0; k < own; ++k) result[order[k]] = true;
  return result;
}

void add_vectree_colors(const GaussianModel& model, const std::vector<float>& weights,
                        std::vector<ZipEntry>& files) {
  const std::size_t columns = std::size_t(3 + 3 * sh_rest_count(model.sh_degree));
  const std::vector<float> colors = colors_of(model, columns);
  const std::vector<bool> has_own = owners(weights);
  const float largest = std::max(*std::max_element(weights.begin(), weights.end()), 1e-30f);
  std::vector<float> own, shared, shared_weights;
  for (std::size_t i = 0; i < weights.size(); ++i) {
    std::vector<float>& to = has_own[i] ? own : shared;
    to.insert(to.end(), colors.begin() + std::ptrdiff_t(i * columns),
              colors.begin() + std::ptrdiff_t((i + 1) * columns));
    if (!has_own[i]) shared_weights.push_back(kLeastColorWeight + weights[i] / largest);
  }
  Palette palette;
  if (shared_weights.size() > kPaletteColors) {
    palette = palette_of(shared, columns, kPaletteColors, shared_weights);
  } else {
    palette = {shared, std::vector<std::uint32_t>(shared_weights.size())};
    std::iota(palette.labels.begin(), palette.labels.end(), 0u);
  }
  palette.centroids.resize(kPaletteColors * columns);  // LightGaussian takes the bits from its size
  constexpr int kWidth = std::bit_width(kPaletteColors) - 1;
  std::vector<bool> bits;
  for (const std::uint32_t label : palette.labels)
    for (int bit = kWidth - 1; bit >= 0; --bit) bits.push_back((label >> bit) & 1);
  const std::vector<std::uint8_t> indices = packed_bits(bits), mask = packed_bits(has_own);
  files.push_back(vectree_file("vq_indexs", "u1", {indices.size()}, indices));
  files.push_back(
      vectree_file("codebook", "f2", {kPaletteColors, columns}, halves_of(palette.centroids)));
  files.push_back(vectree_file("non_vq_mask", "u1", {mask.size()}, mask));
  files.push_back(
      vectree_file("non_vq_feats", "f2", {own.size() / columns, columns}, halves_of(own)));
  files.push_back(metadata_file({{"input_pc_num", weights.size()},
                                 {"input_pc_dim", 3 + 3 + columns + kShapeColumns},
                                 {"codebook_size", kPaletteColors},
                                 {"codebook_dim", columns}}));
}

}  // namespace

GaussianModel read_vectree(const Path& path) {
  ByteReader reader(path);
  const std::size_t size = reader.size();
  const VectreeFiles files(
      path, std::string_view(reinterpret_cast<const char*>(reader.take(size)), size));
  const NpyArray means = files.load("xyz", 3 * (kAlwaysAllowed + size / kLeastBytesEach));
  const std::size_t count = means.size() / 3;
  if (means.shape != std::vector<std::size_t>{count, 3})
    files.fail("has no three numbers in each row of xyz");
  check_count(path, count, size);
  const NpyArray other = files.exactly("other_attribute", kShapeColumns * count);
  GaussianModel model{Gaussians(count, host_memory()), 0, false};
  const Gaussians& g = model.gaussians;
  model.gaussians.sh_rest.fill_zero();
  for (std::size_t i = 0; i < count; ++i) {
    const auto number = [&](std::size_t k) { return float(other.at(kShapeColumns * i + k)); };
    for (int axis = 0; axis < 3; ++axis) {
      g.mean[i][axis] = float(means.at(3 * i + std::size_t(axis)));
      g.log_scale[i][axis] = number(1 + std::size_t(axis));
    }
    g.logit_opacity[i] = number(0);
    g.rotation[i] = {number(4), number(5), number(6), number(7)};
    normalize(&g.rotation[i].w);
  }
  model.sh_degree = take_colors(files, g);
  return model;
}

void write_vectree(ByteSink& sink, const GaussianModel& model, const RowImportance& importance) {
  const Gaussians& g = model.gaussians;
  std::vector<float> means, other;
  for (std::size_t i = 0; i < g.count(); ++i) {
    means.insert(means.end(), {g.mean[i].x, g.mean[i].y, g.mean[i].z});
    other.insert(other.end(),
                 {g.logit_opacity[i], g.log_scale[i].x, g.log_scale[i].y, g.log_scale[i].z,
                  g.rotation[i].w, g.rotation[i].x, g.rotation[i].y, g.rotation[i].z});
  }
  std::vector<ZipEntry> files;
  files.push_back(vectree_file("xyz", "f4", {g.count(), 3}, means));
  files.push_back(
      vectree_file("other_attribute", "f2", {g.count(), kShapeColumns}, halves_of(other)));
  add_vectree_colors(model, importance.color.empty() ? coverages_of(g) : importance.color, files);
  sink.write(zip_of(files));
}

}  // namespace gs
