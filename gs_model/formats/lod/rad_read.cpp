// SPDX-License-Identifier: Apache-2.0
#include <spdlog/fmt/fmt.h>

#include <algorithm>
#include <cmath>

#include "gs_core/system/byte_reader.h"
#include "gs_core/system/text/foreign_text.h"
#include "gs_core/system/text/json.h"
#include "gs_core/system/text/read_json.h"
#include "gs_model/formats/coding/compression.h"
#include "gs_model/formats/coding/count_check.h"
#include "gs_model/formats/coding/finite_rows.h"
#include "gs_model/formats/coding/little_endian.h"
#include "gs_model/formats/coding/quantize.h"
#include "gs_model/formats/lod/rad.h"
#include "gs_model/formats/lod/rad_layout.h"
#include "gs_model/formats/lod/rad_values.h"

namespace gs {
namespace {

using Path = std::filesystem::path;

constexpr const char* kRemedyOfRad = "copy or export the file again";

/// Bytes of the file, and Errors about them.
class RadBytes {
 public:
  RadBytes(const Path& path, std::string_view bytes) : path(path), bytes_(bytes) {}

  std::string_view part(std::uint64_t offset, std::uint64_t count) const {
    if (offset > bytes_.size() || count > bytes_.size() - offset) fail("ends too early");
    return bytes_.substr(offset, count);
  }
  std::uint64_t size() const { return bytes_.size(); }
  /// The JSON behind a magic number at `at`, which then lies behind its padding.
  SortedJson head(std::uint64_t& at, std::uint32_t magic) const {
    const std::string_view begin = part(at, 8);
    if (load_little<std::uint32_t>(begin.data()) != magic)
      fail("lacks a mark of the format where one must be");
    const auto count = load_little<std::uint32_t>(begin.data() + 4);
    const SortedJson json = parse_json<SortedJson>(path, part(at + 8, count), kRemedyOfRad);
    if (!json.is_object()) fail("has a header that is no JSON object");
    if (number(json, "version") != 1)
      cannot_read(path, "it is a .rad of a version other than 1; export it as version 1");
    at += 8 + count + rad_padding(count);
    return json;
  }
  std::uint64_t number(const SortedJson& json, const char* key) const {
    if (!json.is_object() || !json.contains(key) || !json[key].is_number_unsigned())
      fail(fmt::format("has no valid number \"{}\"", key));
    return json[key].get<std::uint64_t>();
  }
  std::string word(const SortedJson& json, const char* key) const {
    if (!json.is_object() || !json.contains(key) || !json[key].is_string())
      fail(fmt::format("has no text \"{}\"", key));
    return json[key].get<std::string>();
  }
  [[noreturn]] void fail(const std::string& what) const {
    cannot_read(path, fmt::format("as a .rad it {}; it is damaged, {}", what, kRemedyOfRad));
  }

  const Path& path;

 private:
  std::string_view bytes_;
};

/// A chunk's Gaussians, between `least` and `most`, and the numbers of their children.
class RadChunk {
 public:
  RadChunk(const RadBytes& bytes, std::uint64_t at, std::uint64_t end, std::uint64_t least,
           std::uint64_t most)
      : bytes_(bytes) {
    json_ = bytes.head(at, kRadChunkMagic);
    count_ = bytes.number(json_, "count");
    if (count_ < least || count_ > most) bytes.fail("has a chunk of another size");
    if (!json_.contains("properties") || !json_["properties"].is_array())
      bytes.fail("has a chunk without properties");
    payload_ = at + 8;  // behind the number of its bytes
    end_ = end;
  }

  /// (count, numbers); nothing where the chunk has no such property and it is `optional`.
  std::vector<float> values(const char* property, std::size_t numbers,
                            bool optional = false) const {
    const SortedJson* json = find(property);
    if (!json && optional) return {};
    if (!json) bytes_.fail(fmt::format("lacks {}", property));
    const std::string encoding = bytes_.word(*json, "encoding");
    const std::size_t each = bytes_of_encoding(encoding);
    if (each == 0) unknown(property, encoding);
    return decoded(encoding, data(*json, each * numbers * count_), count_, numbers,
                   limit(*json, "min"), limit(*json, "max"));
  }
  std::vector<Quatf> rotations() const {
    const SortedJson* json = find("orientation");
    std::vector<Quatf> result(count_);
    if (json && bytes_.word(*json, "encoding") == "oct88r8") {
      const std::string raw = data(*json, kOctBytes * count_);
      for (std::size_t i = 0; i < count_; ++i)
        result[i] = from_oct88r8(reinterpret_cast<const std::uint8_t*>(&raw[kOctBytes * i]));
      return result;
    }
    const std::vector<float> xyz = values("orientation", 3);
    for (std::size_t i = 0; i < count_; ++i) {
      const float x = xyz[3 * i], y = xyz[3 * i + 1], z = xyz[3 * i + 2];
      result[i] = {std::sqrt(std::max(0.0f, 1 - x * x - y * y - z * z)), x, y, z};
    }
    return result;
  }
  /// Which Gaussians have no children.
  std::vector<bool> is_leaf() const {
    std::vector<bool> result(count_, true);
    const SortedJson* json = find("child_count");
    if (!json) return result;
    if (bytes_.word(*json, "encoding") != "u16")
      unknown("child_count", bytes_.word(*json, "encoding"));
    const std::string raw = data(*json, 2 * count_);
    for (std::size_t i = 0; i < count_; ++i)
      result[i] = load_little<std::uint16_t>(&raw[2 * i]) == 0;
    return result;
  }
  bool has(const char* property) const { return find(property); }
  std::size_t count() const { return count_; }

 private:
  const SortedJson* find(const char* property) const {
    for (const SortedJson& json : json_["properties"])
      if (bytes_.word(json, "property") == property) return &json;
    return nullptr;
  }
  std::string data(const SortedJson& json, std::size_t size) const {
    const std::uint64_t offset = bytes_.number(json, "offset"),
                        count = bytes_.number(json, "bytes");
    if (offset > end_ - std::min(end_, payload_)) bytes_.fail("has a property beyond its chunk");
    const std::string_view packed = bytes_.part(payload_ + offset, count);
    if (!json.contains("compression") || json["compression"].is_null()) {
      if (packed.size() != size) bytes_.fail("has a property of another size");
      return std::string(packed);
    }
    if (bytes_.word(json, "compression") != "gz")
      unknown("compression", bytes_.word(json, "compression"));
    return inflate_raw(bytes_.path, packed, size);
  }
  float limit(const SortedJson& json, const char* key) const {
    return json.contains(key) && json[key].is_number() ? json[key].get<float>() : 0;
  }
  [[noreturn]] void unknown(const std::string& what, const std::string& word) const {
    cannot_read(bytes_.path, fmt::format("its {} is {}, which gemsplat does not read; export it "
                                         "again with the default encodings of build-lod",
                                         what, shown_word(word)));
  }

  const RadBytes& bytes_;
  std::size_t count_ = 0;
  SortedJson json_;
  std::uint64_t payload_ = 0, end_ = 0;
};

// Appends the Gaussians without children.
void append_leaves(const RadChunk& chunk, int sh_degree, Gaussians& g) {
  const std::vector<bool> is_leaf = chunk.is_leaf();
  const std::vector<float> means = chunk.values("center", 3), alphas = chunk.values("alpha", 1),
                           colors = chunk.values("rgb", 3), scales = chunk.values("scales", 3);
  const std::vector<Quatf> rotations = chunk.rotations();
  std::vector<float> sh[3];
  for (int band = 0; band < sh_degree; ++band)
    sh[band] =
        chunk.values(kRadBands[band].property, std::size_t(3 * kRadBands[band].coefficients), true);
  std::size_t row = g.count();
  g.resize(row + std::size_t(std::count(is_leaf.begin(), is_leaf.end(), true)));
  for (std::size_t i = 0; i < chunk.count(); ++i) {
    if (!is_leaf[i]) continue;
    const auto at = [&](const std::vector<float>& v) {
      return Vec3f{v[3 * i], v[3 * i + 1], v[3 * i + 2]};
    };
    g.mean[row] = at(means);
    g.log_scale[row] = log_of_scale(at(scales));
    g.rotation[row] = rotations[i];
    normalize(&g.rotation[row].w);
    g.logit_opacity[row] = float(logit(std::clamp(double(alphas[i]), 1e-6, 0.9999)));
    for (int k = 0; k < 3; ++k) g.sh0[row][k] = sh0_of_color(at(colors)[k]);
    g.sh_rest[row] = {};
    for (int band = 0; band < sh_degree; ++band) {
      const auto [property, first, coefficients] = kRadBands[band];
      if (sh[band].empty()) continue;
      std::copy_n(&sh[band][std::size_t(3 * coefficients) * i], 3 * coefficients,
                  &g.sh_rest[row].coefficient[first].x);
    }
    ++row;
  }
}

}  // namespace

GaussianModel read_rad(const Path& path) {
  ByteReader reader(path);
  const std::size_t size = reader.size();
  const RadBytes bytes(path, {reinterpret_cast<const char*>(reader.take(size)), size});
  std::uint64_t begin = 0;
  const SortedJson head = bytes.head(begin, kRadMagic);
  const std::uint64_t count = bytes.number(head, "count");
  check_count(path, count, size);
  const std::uint64_t each = head.contains("chunkSize") ? bytes.number(head, "chunkSize") : count;
  const std::uint64_t degree = head.contains("maxSh") ? bytes.number(head, "maxSh") : 0;
  if (degree > kMaxShDegree) bytes.fail("has an SH degree above 3");
  if (!head.contains("chunks") || !head["chunks"].is_array() || (each == 0 && count > 0) ||
      head["chunks"].size() != (count == 0 ? 0 : (count - 1) / each + 1))
    bytes.fail("names another number of chunks than its Gaussians need");
  const std::string comment =
      head.contains("comment") && head["comment"].is_string() ? head["comment"] : SortedJson("");
  GaussianModel model{Gaussians(), int(degree), comment.starts_with("gemsplat "),
                      comment.ends_with(" antialiased")};
  std::uint64_t done = 0;
  for (const SortedJson& range : head["chunks"]) {
    if (range.is_object() && range.contains("filename"))
      cannot_read(path, "its chunks are files of their own; export it as one file");
    const std::uint64_t offset = bytes.number(range, "offset"),
                        length = bytes.number(range, "bytes");
    bytes.part(begin, offset);
    bytes.part(begin + offset, length);
    const std::uint64_t most = std::min(each, count - done);
    done += most;  // numbers; only the last chunk must use all of its own
    const RadChunk chunk(bytes, begin + offset, begin + offset + length, done == count ? most : 0,
                         most);
    if (chunk.has("sh_label"))
      cannot_read(path,
                  "its SH are a palette, which gemsplat does not read; export it again "
                  "without clusters of SH");
    append_leaves(chunk, int(degree), model.gaussians);
  }
  return model;
}

}  // namespace gs
