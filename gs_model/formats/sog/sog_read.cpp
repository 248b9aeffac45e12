// SPDX-License-Identifier: Apache-2.0
#include <spdlog/fmt/fmt.h>

#include <algorithm>

#include "gs_core/system/byte_reader.h"
#include "gs_core/system/text/foreign_text.h"
#include "gs_core/system/text/json.h"
#include "gs_core/system/text/read_json.h"
#include "gs_model/formats/coding/count_check.h"
#include "gs_model/formats/coding/finite_rows.h"
#include "gs_model/formats/coding/quantize.h"
#include "gs_model/formats/coding/zip_file.h"
#include "gs_model/formats/sog/sog.h"
#include "gs_model/formats/sog/sog_layout.h"
#include "gs_model/formats/sog/webp.h"

namespace gs {
namespace {

using Path = std::filesystem::path;

constexpr const char *kMeta = "meta.json", *kRemedyOfSog = "export the file again";

/// The files by name, and the bytes of all of them.
struct SogFiles {
  std::map<std::string, std::string_view> entries;
  std::size_t bytes = 0;
};

/// meta.json and the pictures that it names. What is missing or of another kind is an Error.
class Sog {
 public:
  Sog(const Path& path, SogFiles files)
      : path_(path), entries_(std::move(files.entries)), file_bytes_(files.bytes) {
    const auto entry = entries_.find(kMeta);
    if (entry == entries_.end()) fail("lacks meta.json");
    meta_ = parse_json<SortedJson>(path_ / kMeta, entry->second, kRemedyOfSog);
    if (!meta_.is_object()) fail("has a meta.json that is not a JSON object");
    if (number(meta_, "version", 1000) != kSogVersion)
      cannot_read(path_, "it is a .sog of a version other than 2; export it again as version 2");
    count_ = number(meta_, "count", std::uint32_t(-1));
    check_count(path_, count_, file_bytes_);
  }

  std::size_t count() const { return count_; }
  bool is_antialiased() const { return meta_.contains("model") && meta_["model"] == "antialiased"; }
  bool is_ours() const {
    const auto asset = meta_.find("asset");
    if (asset == meta_.end() || !asset->is_object()) return false;
    const auto generator = asset->find("generator");
    return generator != asset->end() && generator->is_string() &&
           generator->get<std::string>().starts_with("gemsplat ");
  }
  bool has(const char* key) const { return meta_.contains(key); }
  const SortedJson& section(const char* key) const {
    if (!meta_.contains(key) || !meta_[key].is_object()) fail(fmt::format("lacks {}", key));
    return meta_[key];
  }
  std::uint64_t number(const SortedJson& object, const char* key, std::uint64_t most) const {
    if (!object.contains(key) || !object[key].is_number_unsigned() ||
        object[key].get<std::uint64_t>() > most)
      fail(fmt::format("has no valid number \"{}\"", key));
    return object[key].get<std::uint64_t>();
  }
  std::vector<float> numbers(const SortedJson& object, const char* key, std::size_t count) const {
    std::vector<float> result;
    if (object.contains(key) && object[key].is_array())
      for (const SortedJson& value : object[key])
        if (value.is_number()) result.push_back(value.get<float>());
    if (result.size() != count) fail(fmt::format("has no {} numbers in \"{}\"", count, key));
    return result;
  }
  /// The picture that stands at `index` of "files", of at least `pixels` pixels.
  Image8 picture(const SortedJson& object, std::size_t index, std::size_t pixels) const {
    const SortedJson* files = object.contains("files") ? &object["files"] : nullptr;
    if (!files || !files->is_array() || files->size() <= index || !(*files)[index].is_string())
      fail("names too few files");
    const std::string name = (*files)[index].get<std::string>();
    const auto entry = entries_.find(name);
    if (entry == entries_.end()) fail("lacks " + shown_word(name));
    constexpr std::size_t kPadding = 4096;  // pixels allowed beyond twice the count
    Image8 picture = read_webp(path_, name, entry->second, 2 * pixels + kPadding);
    if (picture.pixels.size() < 4 * pixels)
      fail(fmt::format("has too small a picture {}", shown_word(name)));
    return picture;
  }
  [[noreturn]] void fail(const std::string& what) const {
    cannot_read(path_, fmt::format("as a .sog it {}; the file is damaged, export it again", what));
  }

 private:
  const Path& path_;
  std::map<std::string, std::string_view> entries_;
  std::size_t file_bytes_;
  SortedJson meta_;
  std::size_t count_ = 0;
};

const std::uint8_t* pixel(const Image8& picture, std::size_t i) { return &picture.pixels[4 * i]; }

/// Positions as two pictures, of the lower and the upper bytes.
struct MeansPictures {
  Image8 lower, upper;
};

MeansPictures means_pictures(const Sog& sog) {
  if (sog.count() == 0) return {};
  const SortedJson& means = sog.section("means");
  return {sog.picture(means, 0, sog.count()), sog.picture(means, 1, sog.count())};
}

void read_means(const Sog& sog, const MeansPictures& pictures, const Gaussians& g) {
  const SortedJson& means = sog.section("means");
  const std::vector<float> low = sog.numbers(means, "mins", 3),
                           high = sog.numbers(means, "maxs", 3);
  for (std::size_t i = 0; i < g.count(); ++i)
    for (int axis = 0; axis < 3; ++axis) {
      const int word = pixel(pictures.lower, i)[axis] | pixel(pictures.upper, i)[axis] << 8;
      g.mean[i][axis] = sog_exp(low[axis] + (high[axis] - low[axis]) * (float(word) / 65535));
    }
}

void read_rotations(const Sog& sog, const Gaussians& g) {
  const Image8 picture = sog.picture(sog.section("quats"), 0, g.count());
  for (std::size_t i = 0; i < g.count(); ++i) {
    const std::uint8_t* p = pixel(picture, i);
    if (p[3] < kSogRotationTag) sog.fail("has a value that is not a rotation");
    const auto part = [&](int k) { return (from_unorm(p[k], 8) - 0.5f) / kSqrtHalf; };
    const auto [w, x, y, z] = quaternion_of({p[3] - kSogRotationTag, {part(0), part(1), part(2)}});
    g.rotation[i] = {w, x, y, z};
    normalize(&g.rotation[i].w);
  }
}

// Returns the picture, whose alpha may mean something else.
Image8 read_coded(const Sog& sog, const char* key, const Buffer<Vec3f>& rows) {
  const SortedJson& section = sog.section(key);
  const std::vector<float> book = sog.numbers(section, "codebook", kSogCodebook);
  Image8 picture = sog.picture(section, 0, rows.size());
  for (std::size_t i = 0; i < rows.size(); ++i)
    for (int k = 0; k < 3; ++k) rows[i][k] = book[pixel(picture, i)[k]];
  return picture;
}

// Returns the SH degree.
int read_sh(const Sog& sog, const Gaussians& g) {
  const SortedJson& section = sog.section("shN");
  const int degree = int(sog.number(section, "bands", kMaxShDegree));
  const std::size_t size = sog.number(section, "count", kSogLargestPalette);
  const std::size_t rest = std::size_t(sh_rest_count(degree));
  const std::vector<float> book = sog.numbers(section, "codebook", kSogCodebook);
  const Image8 centroids = sog.picture(section, 0, size * rest);
  const Image8 labels = sog.picture(section, 1, g.count());
  if (std::size_t(centroids.width) != kSogPaletteColumns * rest)
    sog.fail("has a palette of another width than 64 entries");
  for (std::size_t i = 0; i < g.count(); ++i) {
    const std::size_t label = pixel(labels, i)[0] | pixel(labels, i)[1] << 8;
    if (label >= size) sog.fail("names an entry beyond its palette");
    for (std::size_t k = 0; k < rest; ++k)
      for (int channel = 0; channel < 3; ++channel)
        g.sh_rest[i].coefficient[k][channel] = book[pixel(centroids, label * rest + k)[channel]];
  }
  return degree;
}

GaussianModel model_of(const Path& path, SogFiles files) {
  const Sog sog(path, std::move(files));
  const MeansPictures means = means_pictures(sog);  // fails before memory for Gaussians is taken
  GaussianModel model{Gaussians(sog.count(), host_memory()), 0, sog.is_ours(),
                      sog.is_antialiased()};
  const Gaussians& g = model.gaussians;
  model.gaussians.sh_rest.fill_zero();
  if (sog.count() == 0) return model;
  read_means(sog, means, g);
  read_rotations(sog, g);
  read_coded(sog, "scales", g.log_scale);
  const Image8 sh0 = read_coded(sog, "sh0", g.sh0);
  for (std::size_t i = 0; i < g.count(); ++i) g.logit_opacity[i] = logit_of_byte(pixel(sh0, i)[3]);
  if (sog.has("shN")) model.sh_degree = read_sh(sog, g);
  return model;
}

std::string bytes_of(const Path& file) {
  ByteReader reader(file);
  const std::size_t size = reader.size();
  return {reinterpret_cast<const char*>(reader.take(size)), size};
}

// The names in "files" of all sections. Those that lead to another folder are left out.
std::vector<std::string> named_files(const SortedJson& meta) {
  std::vector<std::string> names;
  if (!meta.is_object()) return names;
  for (const SortedJson& section : meta) {
    if (!section.is_object() || !section.contains("files") || !section["files"].is_array())
      continue;
    for (const SortedJson& name : section["files"]) {
      if (!name.is_string()) continue;
      const auto text = name.get<std::string>();
      if (text != "." && text != ".." && Path(text).filename() == text) names.push_back(text);
    }
  }
  return names;
}

}  // namespace

GaussianModel read_sog(const Path& path) {
  ByteReader reader(path);
  const std::size_t size = reader.size();
  if (size >= 2 && std::string_view(reinterpret_cast<const char*>(reader.peek(2)), 2) != "PK")
    cannot_read(path,
                "it is not a zip archive, and every .sog file is one; copy or export it again");
  const std::string_view bytes(reinterpret_cast<const char*>(reader.take(size)), size);
  return model_of(path, {zip_entries(path, bytes), size});
}

GaussianModel read_sog_folder(const Path& path) {
  std::map<std::string, std::string> owned;
  owned[kMeta] = read_json_text(path);
  for (const std::string& name :
       named_files(parse_json<SortedJson>(path, owned[kMeta], kRemedyOfSog)))
    if (std::error_code missing;
        !owned.contains(name) && std::filesystem::exists(path.parent_path() / name, missing))
      owned[name] = bytes_of(path.parent_path() / name);
  SogFiles files;
  for (const auto& [name, bytes] : owned) {
    files.entries[name] = bytes;
    files.bytes += bytes.size();
  }
  return model_of(path, std::move(files));
}

}  // namespace gs
