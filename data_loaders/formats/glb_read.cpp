// SPDX-License-Identifier: Apache-2.0
// Reads a .glb in three steps: chunks, the one primitive of Gaussians, and its accessors. Every
// number of the JSON is checked before it is used as an index or a size.
#include <spdlog/fmt/fmt.h>

#include <cmath>
#include <optional>

#include "data_loaders/formats/coding/count_check.h"
#include "data_loaders/formats/coding/finite_rows.h"
#include "data_loaders/formats/coding/frame.h"
#include "data_loaders/formats/coding/little_endian.h"
#include "data_loaders/formats/coding/quantize.h"
#include "data_loaders/formats/glb.h"
#include "data_loaders/formats/spz/spz.h"
#include "gs_core/io/byte_reader.h"
#include "gs_core/io/read_json.h"

namespace gs {
namespace {

using Json = nlohmann::json;
using Path = std::filesystem::path;

constexpr const char* kRemedy = "export the model again";
// Names under which an .spz stands in glTF: that of the draft, and two older ones.
constexpr const char* kSpzExtensions[] = {"KHR_gaussian_splatting_compression_spz_2",
                                          "KHR_gaussian_splatting_compression_spz",
                                          "KHR_spz_gaussian_splats_compression"};

/// A file's JSON and its binary chunk. What is missing or of another kind is an Error.
class Glb {
 public:
  Glb(const Path& path, std::string_view file) : path_(path), file_bytes_(file.size()) {
    if (file.size() < 20 || word(file, 0) != kGlbMagic) fail("does not begin as .glb files do");
    if (word(file, 4) != kGlbVersion) fail("is not of version 2 of glTF");
    if (word(file, 16) != kGlbJson) fail("does not begin with its JSON");
    const std::string_view rest = file.substr(20);
    const std::size_t json_bytes = word(file, 12);
    if (json_bytes > rest.size()) fail("is cut short");
    document_ = parse_json<Json>(path, rest.substr(0, json_bytes), kRemedy);
    const std::string_view second = rest.substr(json_bytes);
    if (second.size() < 8) return;  // without binary chunk; accessors then fail
    if (word(second, 4) != kGlbBinary || word(second, 0) > second.size() - 8)
      fail("has no whole binary chunk");
    binary_ = second.substr(8, word(second, 0));
  }

  const Json& document() const { return document_; }
  std::uint64_t file_bytes() const { return file_bytes_; }

  /// An element of one of the document's lists.
  const Json& item(const char* list, std::uint64_t index) const {
    const Json* items = find(document_, list);
    if (!items || !items->is_array() || index >= items->size() || !(*items)[index].is_object())
      fail(fmt::format("lacks an entry of \"{}\"", list));
    return (*items)[index];
  }
  /// A whole number of an object, at most 2^53.
  std::uint64_t number(const Json& object, const char* key,
                       std::optional<std::uint64_t> otherwise = {}) const {
    const Json* value = find(object, key);
    if (!value && otherwise) return *otherwise;
    if (!value || !value->is_number_unsigned() ||
        value->get<std::uint64_t>() > std::uint64_t(1) << 53)
      fail(fmt::format("has no valid number \"{}\"", key));
    return value->get<std::uint64_t>();
  }
  /// The bytes of a view of the binary chunk.
  std::string_view view(std::uint64_t index) const {
    const Json& view = item("bufferViews", index);
    if (number(view, "buffer") != 0 || find(item("buffers", 0), "uri"))
      fail("has its numbers in another file");
    const std::uint64_t at = number(view, "byteOffset", 0), bytes = number(view, "byteLength");
    if (at > binary_.size() || bytes > binary_.size() - at) fail("has a view beyond its end");
    return binary_.substr(at, bytes);
  }
  static const Json* find(const Json& object, const char* key) {
    if (!object.is_object()) return nullptr;
    const auto found = object.find(key);
    return found == object.end() ? nullptr : &*found;
  }
  [[noreturn]] void fail(const std::string& what) const {
    cannot_read(path_, fmt::format("as a .glb it {}; {}", what, kRemedy));
  }

 private:
  static std::uint32_t word(std::string_view bytes, std::size_t at) {
    return load_little<std::uint32_t>(bytes.data() + at);
  }

  const Path& path_;
  std::uint64_t file_bytes_;
  Json document_;
  std::string_view binary_;
};

/// Numbers of an attribute, as floats.
class Accessor {
 public:
  /// `width` numbers a row. Whole numbers count as fractions where the accessor says so.
  Accessor(const Glb& glb, std::uint64_t index, std::size_t width) {
    const Json& accessor = glb.item("accessors", index);
    constexpr const char* kTypes[] = {"", "SCALAR", "VEC2", "VEC3", "VEC4"};
    const Json* type = Glb::find(accessor, "type");
    if (!type || *type != kTypes[width])
      glb.fail(fmt::format("has an attribute that is not a {}", kTypes[width]));
    if (Glb::find(accessor, "sparse")) glb.fail("has sparse attributes, which are not read");
    component_ = glb.number(accessor, "componentType");
    const Json* normalized = Glb::find(accessor, "normalized");
    normalized_ = normalized && *normalized == true;
    const std::size_t bytes = component_bytes();
    if (bytes == 0) glb.fail("has an attribute of a type that Gaussians do not have");
    count_ = glb.number(accessor, "count");
    const std::uint64_t view = glb.number(accessor, "bufferView");
    const std::string_view all = glb.view(view);
    stride_ = glb.number(glb.item("bufferViews", view), "byteStride", bytes * width);
    const std::uint64_t at = glb.number(accessor, "byteOffset", 0), row = bytes * width;
    if (stride_ < row || stride_ > 252) glb.fail("has a stride that glTF does not allow");
    if (at > all.size() ||
        (count_ > 0 && (all.size() - at < row || (count_ - 1) > (all.size() - at - row) / stride_)))
      glb.fail("has an attribute beyond the end of its view");
    rows_ = all.substr(at);
  }

  std::size_t count() const { return count_; }
  float operator()(std::size_t row, std::size_t column) const {
    const char* at = rows_.data() + row * stride_ + column * component_bytes();
    switch (component_) {
      case 5120: return scaled(load_little<std::int8_t>(at), 127);
      case 5121: return scaled(load_little<std::uint8_t>(at), 255);
      case 5122: return scaled(load_little<std::int16_t>(at), 32767);
      case 5123: return scaled(load_little<std::uint16_t>(at), 65535);
      default: return load_little<float>(at);
    }
  }
  Vec3f vec3(std::size_t row) const { return {(*this)(row, 0), (*this)(row, 1), (*this)(row, 2)}; }

 private:
  std::size_t component_bytes() const {
    return component_ == 5126                         ? 4
           : component_ == 5122 || component_ == 5123 ? 2
           : component_ == 5120 || component_ == 5121 ? 1
                                                      : 0;
  }
  float scaled(int value, int most) const {
    return normalized_ ? std::max(float(value) / float(most), -1.0f) : float(value);
  }

  std::uint64_t component_ = 0, count_ = 0, stride_ = 0;
  bool normalized_ = false;
  std::string_view rows_;
};

const Json* spz_of(const Json& extensions) {
  for (const char* name : kSpzExtensions)
    if (const Json* spz = Glb::find(extensions, name)) return spz;
  return nullptr;
}

/// The extensions of a primitive that holds Gaussians, or null.
const Json* gaussians_in(const Json& primitive) {
  const Json* extensions = Glb::find(primitive, "extensions");
  if (!extensions) return nullptr;
  return Glb::find(*extensions, kGlbGaussians) || spz_of(*extensions) ? extensions : nullptr;
}

/// The one primitive with Gaussians.
const Json& primitive_of(const Glb& glb, const Path& path) {
  const Json* found = nullptr;
  const Json* meshes = Glb::find(glb.document(), "meshes");
  for (std::size_t m = 0; meshes && meshes->is_array() && m < meshes->size(); ++m) {
    const Json* primitives = Glb::find((*meshes)[m], "primitives");
    for (std::size_t p = 0; primitives && primitives->is_array() && p < primitives->size(); ++p) {
      if (!gaussians_in((*primitives)[p])) continue;
      if (found)
        cannot_read(path,
                    "it has several primitives with Gaussians, but gemsplat reads one; export "
                    "each one to a file");
      found = &(*primitives)[p];
    }
  }
  if (!found)
    cannot_read(path,
                "it holds no Gaussians (KHR_gaussian_splatting); name a model of Gaussians, not of "
                "triangles");
  return *found;
}

/// Nodes that turn, move or scale are refused: their Gaussians would stand elsewhere.
void check_nodes(const Glb& glb, const Path& path) {
  const Json* nodes = Glb::find(glb.document(), "nodes");
  for (std::size_t n = 0; nodes && nodes->is_array() && n < nodes->size(); ++n)
    for (const char* key : {"matrix", "rotation", "scale", "translation"})
      if (Glb::find((*nodes)[n], key))
        cannot_read(path, fmt::format("a node has a \"{}\", which gemsplat does not apply; apply "
                                      "it in the program that wrote the file, and export again",
                                      key));
}

/// A logit between those of opacities that a float tells from 0 and from 1.
float finite_logit(float opacity) {
  constexpr float kLeast = 1e-7f;
  const double inside = clamp_to(double(opacity), double(kLeast), 1 - double(kLeast));
  return std::isfinite(opacity) ? float(logit(inside)) : opacity;
}

GaussianModel plain_model(const Glb& glb, const Json& primitive, const Path& path) {
  const Json* attributes = Glb::find(primitive, "attributes");
  if (!attributes) glb.fail("lacks attributes");
  const auto has = [&](const std::string& name) { return Glb::find(*attributes, name.c_str()); };
  const auto accessor = [&](const std::string& name, std::size_t width) {
    return Accessor(glb, glb.number(*attributes, name.c_str()), width);
  };
  const std::string prefix = std::string(kGlbGaussians) + ":";
  const Accessor mean = accessor("POSITION", 3), rotation = accessor(prefix + "ROTATION", 4),
                 scale = accessor(prefix + "SCALE", 3), opacity = accessor(prefix + "OPACITY", 1);
  std::vector<Accessor> sh = {accessor(prefix + "SH_DEGREE_0_COEF_0", 3)};
  int degree = 0;
  while (degree < kMaxShDegree && has(fmt::format("{}SH_DEGREE_{}_COEF_0", prefix, degree + 1))) {
    ++degree;
    for (int c = 0; c < 2 * degree + 1; ++c)
      sh.push_back(accessor(fmt::format("{}SH_DEGREE_{}_COEF_{}", prefix, degree, c), 3));
  }
  const std::size_t count = mean.count();
  bool same = rotation.count() == count && scale.count() == count && opacity.count() == count;
  for (const Accessor& coefficient : sh) same &= coefficient.count() == count;
  if (!same) glb.fail("has attributes of different lengths");
  check_count(path, count, glb.file_bytes());
  GaussianModel model{Gaussians(count, host_memory()), degree, false, false};
  const Gaussians& g = model.gaussians;
  model.gaussians.sh_rest.fill_zero();
  for (std::size_t i = 0; i < count; ++i) {
    g.mean[i] = mean.vec3(i) * kHalfTurnZ;
    g.log_scale[i] = log_of_scale(scale.vec3(i));
    // As (-y x w -z) of the PLY's rotation it was written: glb.cpp.
    g.rotation[i] = {rotation(i, 2), rotation(i, 1), -rotation(i, 0), -rotation(i, 3)};
    normalize(&g.rotation[i].w);
    g.logit_opacity[i] = finite_logit(opacity(i, 0));
    g.sh0[i] = sh[0].vec3(i);
    for (int k = 0; k < sh_rest_count(degree); ++k)
      g.sh_rest[i].coefficient[k] = sh_sign(k, kHalfTurnZ) * sh[std::size_t(k) + 1].vec3(i);
  }
  return model;
}

void check_color_space(const Json& splatting, const Path& path) {
  const Json* space = Glb::find(splatting, "colorSpace");
  if (space && *space == "lin_rec709_display")
    cannot_read(path,
                "its colors are linear (lin_rec709_display), but gemsplat blends display colors; "
                "export it with the color space srgb_rec709_display");
}

}  // namespace

GaussianModel read_glb(const Path& path) {
  ByteReader reader(path);
  const std::size_t size = reader.size();
  const std::string_view file(reinterpret_cast<const char*>(reader.take(size)), size);
  const Glb glb(path, file);
  const Json& primitive = primitive_of(glb, path);
  const Json& extensions = *gaussians_in(primitive);
  check_nodes(glb, path);
  const Json* splatting = Glb::find(extensions, kGlbGaussians);
  if (splatting) check_color_space(*splatting, path);
  const Json* inner = splatting ? Glb::find(*splatting, "extensions") : nullptr;
  const Json* spz = inner ? spz_of(*inner) : nullptr;
  if (!spz) spz = spz_of(extensions);
  if (spz) {
    // The draft's frame is left, up, forward; older files have the numbers of the .spz as they are.
    const bool is_draft = splatting && Glb::find(*splatting, "kernel");
    return spz_model(path, glb.view(glb.number(*spz, "bufferView")),
                     is_draft ? kHalfTurnX : kHalfTurnZ);
  }
  GaussianModel model = plain_model(glb, primitive, path);
  const Json* extras = Glb::find(primitive, "extras");
  const Json* antialiased = extras ? Glb::find(*extras, "antialiased") : nullptr;
  model.antialiased = antialiased && *antialiased == true;
  return model;
}

}  // namespace gs
