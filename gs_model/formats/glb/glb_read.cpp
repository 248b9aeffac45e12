// SPDX-License-Identifier: Apache-2.0
#include <spdlog/fmt/fmt.h>

#include <cmath>
#include <optional>

#include "gs_core/system/byte_reader.h"
#include "gs_core/system/text/json.h"
#include "gs_core/system/text/read_json.h"
#include "gs_model/formats/coding/count_check.h"
#include "gs_model/formats/coding/finite_rows.h"
#include "gs_model/formats/coding/frame.h"
#include "gs_model/formats/coding/little_endian.h"
#include "gs_model/formats/coding/quantize.h"
#include "gs_model/formats/glb/glb.h"

namespace gs {
namespace {

using Path = std::filesystem::path;

constexpr const char* kRemedyOfGlb = "export the model again";

/// A file's JSON and its binary chunk. What is missing or of another kind is an Error with the file
/// and a remedy. Path and bytes must outlive it.
class GlbFile {
 public:
  GlbFile(const Path& path, std::string_view file) : path_(path) {
    if (file.size() < 20 || word(file, 0) != kGlbMagic) fail("does not begin as .glb files do");
    if (word(file, 4) != kGlbVersion) fail("is not of version 2 of glTF");
    if (word(file, 16) != kGlbJson) fail("does not begin with its JSON");
    const std::string_view rest = file.substr(20);
    const std::size_t json_bytes = word(file, 12);
    if (json_bytes > rest.size()) fail("is cut short");
    document_ = parse_json<SortedJson>(path, rest.substr(0, json_bytes), kRemedyOfGlb);
    const std::string_view second = rest.substr(json_bytes);
    if (second.size() < 8) return;  // without binary chunk; columns then fail
    if (word(second, 4) != kGlbBinary || word(second, 0) > second.size() - 8)
      fail("has no whole binary chunk");
    binary_ = second.substr(8, word(second, 0));
  }

  const Path& path() const { return path_; }
  /// The elements of one of the document's lists; none where there is no such list.
  const SortedJson& list(const char* name) const {
    static const SortedJson kNone = SortedJson::array();
    const SortedJson* items = find(document_, name);
    return items && items->is_array() ? *items : kNone;
  }
  const SortedJson& item(const char* name, std::uint64_t index) const {
    if (index >= list(name).size() || !list(name)[index].is_object())
      fail(fmt::format("lacks an entry of \"{}\"", name));
    return list(name)[index];
  }
  /// A whole number of an object, at most 2^53.
  std::uint64_t number(const SortedJson& object, const char* key,
                       std::optional<std::uint64_t> otherwise = {}) const {
    const SortedJson* value = find(object, key);
    if (!value && otherwise) return *otherwise;
    if (!value || !value->is_number_unsigned() ||
        value->get<std::uint64_t>() > std::uint64_t(1) << 53)
      fail(fmt::format("has no valid number \"{}\"", key));
    return value->get<std::uint64_t>();
  }
  /// The bytes of a view of the binary chunk.
  std::string_view view(std::uint64_t index) const {
    const SortedJson& view = item("bufferViews", index);
    if (number(view, "buffer") != 0 || find(item("buffers", 0), "uri"))
      fail("has its numbers in another file");
    const std::uint64_t at = number(view, "byteOffset", 0), bytes = number(view, "byteLength");
    if (at > binary_.size() || bytes > binary_.size() - at) fail("has a view beyond its end");
    return binary_.substr(at, bytes);
  }
  /// A member of an object; null where it has none, or where it is no object.
  static const SortedJson* find(const SortedJson& object, const char* key) {
    if (!object.is_object()) return nullptr;
    const auto found = object.find(key);
    return found == object.end() ? nullptr : &*found;
  }
  [[noreturn]] void fail(std::string_view what) const {
    cannot_read(path_, fmt::format("as a .glb it {}; {}", what, kRemedyOfGlb));
  }

 private:
  static std::uint32_t word(std::string_view bytes, std::size_t at) {
    return load_little<std::uint32_t>(bytes.data() + at);
  }

  const Path& path_;
  SortedJson document_;
  std::string_view binary_;
};

/// The floats of an attribute, `width` a row.
class GlbColumn {
 public:
  GlbColumn(const GlbFile& glb, std::uint64_t index, std::size_t width) : width_(width) {
    constexpr const char* kTypes[] = {"", "SCALAR", "VEC2", "VEC3", "VEC4"};
    constexpr int kFloat = 5126;
    const SortedJson& accessor = glb.item("accessors", index);
    const SortedJson* type = GlbFile::find(accessor, "type");
    if (!type || *type != kTypes[width])
      glb.fail(fmt::format("has an attribute that is not a {}", kTypes[width]));
    if (GlbFile::find(accessor, "sparse")) glb.fail("has sparse attributes, which are not read");
    if (glb.number(accessor, "componentType") != kFloat)
      glb.fail("has attributes that are not floats, which are not read");
    count_ = glb.number(accessor, "count");
    const std::uint64_t view = glb.number(accessor, "bufferView");
    const std::uint64_t row = sizeof(float) * width, at = glb.number(accessor, "byteOffset", 0);
    if (glb.number(glb.item("bufferViews", view), "byteStride", row) != row)
      glb.fail("has rows with gaps between them, which are not read");
    const std::string_view all = glb.view(view);
    if (at > all.size() || count_ > (all.size() - at) / row)
      glb.fail("has an attribute beyond the end of its view");
    rows_ = all.substr(at);
  }

  std::size_t count() const { return count_; }
  float operator()(std::size_t row, std::size_t column) const {
    return load_little<float>(rows_.data() + sizeof(float) * (row * width_ + column));
  }
  Vec3f vec3(std::size_t row) const { return {(*this)(row, 0), (*this)(row, 1), (*this)(row, 2)}; }

 private:
  std::size_t width_;
  std::uint64_t count_ = 0;
  std::string_view rows_;
};

/// The one primitive of Gaussians in the file.
const SortedJson& primitive_of(const GlbFile& glb) {
  const SortedJson* found = nullptr;
  for (const SortedJson& mesh : glb.list("meshes")) {
    const SortedJson* primitives = GlbFile::find(mesh, "primitives");
    for (std::size_t p = 0; primitives && primitives->is_array() && p < primitives->size(); ++p) {
      const SortedJson* extensions = GlbFile::find((*primitives)[p], "extensions");
      if (!extensions || !GlbFile::find(*extensions, kGlbGaussians)) continue;
      if (found)
        cannot_read(glb.path(),
                    "it holds several sets of Gaussians, and gemsplat reads one; join them in the "
                    "program that wrote the file, and export it again");
      found = &(*primitives)[p];
    }
  }
  if (!found)
    cannot_read(glb.path(),
                "its scene holds no Gaussians (KHR_gaussian_splatting); name a model of Gaussians, "
                "not of triangles");
  return *found;
}

void check_extension(const GlbFile& glb, const SortedJson& splatting) {
  const SortedJson* space = GlbFile::find(splatting, "colorSpace");
  if (space && *space == "lin_rec709_display")
    cannot_read(glb.path(),
                "its colors are linear (lin_rec709_display), but gemsplat blends display colors; "
                "export it with the color space srgb_rec709_display");
  if (const SortedJson* inner = GlbFile::find(splatting, "extensions"); inner && !inner->empty())
    cannot_read(glb.path(),
                "its Gaussians are compressed, as in the tiles of 3D Tiles; name the model that it "
                "was made of, or export it without compression");
}

/// Throws Error where a node turns, scales or moves something: no Gaussian of ours is.
void check_nodes(const GlbFile& glb) {
  static const SortedJson kStill = {{"matrix", {1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1}},
                                    {"rotation", {0, 0, 0, 1}},
                                    {"scale", {1, 1, 1}},
                                    {"translation", {0, 0, 0}}};
  for (const SortedJson& node : glb.list("nodes"))
    for (const auto& [key, still] : kStill.items())
      if (const SortedJson* value = GlbFile::find(node, key.c_str()); value && *value != still)
        cannot_read(
            glb.path(),
            "a node turns, scales or moves what it shows, and gemsplat reads the numbers as "
            "they are; apply the node in the program that wrote the file, and export it "
            "again");
}

/// That of the node, as our writer puts it.
Vec3d world_offset_of(const GlbFile& glb) {
  Vec3d offset(0.0);
  for (const SortedJson& node : glb.list("nodes")) {
    const SortedJson* extras = GlbFile::find(node, "extras");
    const SortedJson* list = extras ? GlbFile::find(*extras, "world_offset") : nullptr;
    if (!list) continue;
    for (std::size_t axis = 0; axis < 3; ++axis) {
      if (!list->is_array() || list->size() != 3 || !(*list)[axis].is_number() ||
          !std::isfinite((*list)[axis].get<double>()))
        glb.fail("has a \"world_offset\" that is not 3 numbers");
      offset[int(axis)] = (*list)[axis].get<double>();
    }
  }
  return offset;
}

/// A logit between those of opacities that a float tells from 0 and from 1.
float finite_logit(float opacity) {
  constexpr float kLeast = 1e-7f;
  const double inside = clamp_to(double(opacity), double(kLeast), 1 - double(kLeast));
  return std::isfinite(opacity) ? float(logit(inside)) : opacity;
}

GaussianModel model_of(const GlbFile& glb, const SortedJson& primitive, std::uint64_t bytes) {
  const SortedJson* attributes = GlbFile::find(primitive, "attributes");
  if (!attributes) glb.fail("lacks attributes");
  const auto column = [&](const std::string& name, std::size_t width) {
    return GlbColumn(glb, glb.number(*attributes, name.c_str()), width);
  };
  const std::string prefix = std::string(kGlbGaussians) + ":";
  const GlbColumn mean = column("POSITION", 3), rotation = column(prefix + "ROTATION", 4),
                  scale = column(prefix + "SCALE", 3), opacity = column(prefix + "OPACITY", 1);
  std::vector<GlbColumn> sh = {column(prefix + "SH_DEGREE_0_COEF_0", 3)};
  int degree = 0;
  for (; degree < kMaxShDegree; ++degree) {
    const std::string name = fmt::format("{}SH_DEGREE_{}_COEF_", prefix, degree + 1);
    if (!GlbFile::find(*attributes, (name + "0").c_str())) break;
    for (int c = 0; c < 2 * degree + 3; ++c) sh.push_back(column(name + std::to_string(c), 3));
  }
  const std::size_t count = mean.count();
  bool same = rotation.count() == count && scale.count() == count && opacity.count() == count;
  for (const GlbColumn& coefficient : sh) same &= coefficient.count() == count;
  if (!same) glb.fail("has attributes of different lengths");
  check_count(glb.path(), count, bytes);
  GaussianModel model{Gaussians(count, host_memory()), degree, false, false};
  const Gaussians& g = model.gaussians;
  model.gaussians.sh_rest.fill_zero();
  for (std::size_t i = 0; i < count; ++i) {
    g.mean[i] = mean.vec3(i) * kHalfTurnZ;
    g.log_scale[i] = log_of_scale(scale.vec3(i));
    // As (-y x w -z) of the PLY's rotation it was written: glb_write.cpp.
    g.rotation[i] = {rotation(i, 2), rotation(i, 1), -rotation(i, 0), -rotation(i, 3)};
    normalize(&g.rotation[i].w);
    g.logit_opacity[i] = finite_logit(opacity(i, 0));
    g.sh0[i] = sh[0].vec3(i);
    for (int k = 0; k < sh_rest_count(degree); ++k)
      g.sh_rest[i].coefficient[k] = sh_sign(k, kHalfTurnZ) * sh[std::size_t(k) + 1].vec3(i);
  }
  return model;
}

}  // namespace

GaussianModel read_glb(const Path& path) {
  ByteReader reader(path);
  const std::size_t size = reader.size();
  const GlbFile glb(path, {reinterpret_cast<const char*>(reader.take(size)), size});
  const SortedJson& primitive = primitive_of(glb);
  check_extension(glb, primitive["extensions"][kGlbGaussians]);
  check_nodes(glb);
  GaussianModel model = model_of(glb, primitive, size);
  model.world_offset = world_offset_of(glb);
  const SortedJson* extras = GlbFile::find(primitive, "extras");
  const SortedJson* antialiased = extras ? GlbFile::find(*extras, "antialiased") : nullptr;
  model.antialiased = antialiased && *antialiased == true;
  return model;
}

}  // namespace gs
