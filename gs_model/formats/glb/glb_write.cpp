// SPDX-License-Identifier: Apache-2.0
#include "gs_model/formats/glb/glb.h"

#include <spdlog/fmt/fmt.h>

#include <algorithm>
#include <functional>
#include <limits>

#include "gs_core/error.h"
#include "gs_core/system/text/json.h"
#include "gs_core/system/version.h"
#include "gs_model/formats/coding/frame.h"
#include "gs_model/formats/coding/little_endian.h"
#include "gs_model/formats/coding/quantize.h"

namespace gs {
namespace {

// Numbers of glTF, which has them from OpenGL.
constexpr int kFloat = 5126, kUnsignedByte = 5121, kPoints = 0, kVertexData = 34962;

/// One attribute of the points.
struct Attribute {
  std::string name;
  int component_type;
  const char* type;  // SCALAR, VEC3, ...
  std::size_t row_bytes;
  std::function<void(std::size_t i, std::uint8_t* row)> fill;
};

template <class T>
void store(std::uint8_t* row, const T& value) {
  std::memcpy(row, &value, sizeof value);
}

Vec3f turned_mean(const Gaussians& g, std::size_t i) { return g.mean[i] * kHalfTurnZ; }

std::vector<Attribute> attributes_of(const GaussianModel& model) {
  const Gaussians& g = model.gaussians;
  const std::string prefix = std::string(kGlbGaussians) + ":";
  std::vector<Attribute> list;
  const auto add_vec3 = [&](const std::string& name, auto&& value) {
    list.push_back({name, kFloat, "VEC3", 12,
                    [value](std::size_t i, std::uint8_t* row) { store(row, value(i)); }});
  };
  add_vec3("POSITION", [&g](std::size_t i) { return turned_mean(g, i); });
  list.push_back({"COLOR_0", kUnsignedByte, "VEC4", 4, [&g](std::size_t i, std::uint8_t* row) {
                    for (int channel = 0; channel < 3; ++channel)
                      row[channel] =
                          std::uint8_t(to_unorm(linear_of(color_of_sh0(g.sh0[i][channel])), 8));
                    row[3] = std::uint8_t(opacity_byte(g.logit_opacity[i]));
                  }});
  list.push_back({prefix + "ROTATION", kFloat, "VEC4", 16, [&g](std::size_t i, std::uint8_t* row) {
                    const Quatf& q = g.rotation[i];
                    // (0 0 0 1) q: first q, then half a turn about z
                    store(row, Vec4f(-q.y, q.x, q.w, -q.z));
                  }});
  add_vec3(prefix + "SCALE", [&g](std::size_t i) {
    const Vec3f& s = g.log_scale[i];
    return Vec3f(finite_exp(s.x), finite_exp(s.y), finite_exp(s.z));
  });
  list.push_back({prefix + "OPACITY", kFloat, "SCALAR", 4, [&g](std::size_t i, std::uint8_t* row) {
                    store(row, sigmoid(g.logit_opacity[i]));
                  }});
  add_vec3(prefix + "SH_DEGREE_0_COEF_0", [&g](std::size_t i) { return g.sh0[i]; });
  for (int degree = 1, k = 0; degree <= model.sh_degree; ++degree)
    for (int c = 0; c < 2 * degree + 1; ++c, ++k)
      add_vec3(fmt::format("{}SH_DEGREE_{}_COEF_{}", prefix, degree, c), [&g, k](std::size_t i) {
        return sh_sign(k, kHalfTurnZ) * g.sh_rest[i].coefficient[k];
      });
  return list;
}

Json document_of(const GaussianModel& model, const std::vector<Attribute>& attributes) {
  const std::size_t count = model.gaussians.count();
  Json views, accessors, indices;
  std::size_t offset = 0;
  for (const Attribute& attribute : attributes) {
    indices[attribute.name] = accessors.size();
    Json accessor = {{"bufferView", views.size()},
                     {"componentType", attribute.component_type},
                     {"count", count},
                     {"type", attribute.type}};
    if (attribute.component_type == kUnsignedByte) accessor["normalized"] = true;
    accessors.push_back(accessor);
    views.push_back({{"buffer", 0},
                     {"byteOffset", offset},
                     {"byteLength", count * attribute.row_bytes},
                     {"target", kVertexData}});
    offset += count * attribute.row_bytes;
  }
  Vec3f low = turned_mean(model.gaussians, 0), high = low;
  for (std::size_t i = 1; i < count; ++i)
    for (int axis = 0; axis < 3; ++axis) {
      const float value = turned_mean(model.gaussians, i)[axis];
      low[axis] = std::min(low[axis], value);
      high[axis] = std::max(high[axis], value);
    }
  accessors[0]["min"] = {low.x, low.y, low.z};
  accessors[0]["max"] = {high.x, high.y, high.z};
  const Json splatting = {{"kernel", "ellipse"},
                          {"colorSpace", "srgb_rec709_display"},
                          {"projection", "perspective"},
                          {"sortingMethod", "cameraDistance"}};
  const Json primitive = {{"mode", kPoints},
                          {"attributes", indices},
                          {"extensions", {{kGlbGaussians, splatting}}},
                          {"extras", {{"antialiased", model.antialiased}}}};
  Json node = {{"mesh", 0}};
  const Vec3d& world = model.world_offset;
  if (world != Vec3d(0.0)) node["extras"] = {{"world_offset", {world.x, world.y, world.z}}};
  return {{"asset", {{"version", "2.0"}, {"generator", fmt::format("gemsplat {}", kVersion)}}},
          {"extensionsUsed", Json::array({kGlbGaussians})},
          {"scene", 0},
          {"scenes", Json::array({{{"nodes", Json::array({0})}}})},
          {"nodes", Json::array({node})},
          {"meshes", Json::array({{{"primitives", Json::array({primitive})}}})},
          {"accessors", accessors},
          {"bufferViews", views},
          {"buffers", Json::array({{{"byteLength", offset}}})}};
}

}  // namespace

std::string glb_head(std::string json, std::uint64_t binary_bytes) {
  json.resize((json.size() + 3) / 4 * 4, ' ');
  std::string head;
  for (const std::uint64_t word :
       {std::uint64_t(kGlbMagic), std::uint64_t(kGlbVersion), 28 + json.size() + binary_bytes,
        std::uint64_t(json.size()), std::uint64_t(kGlbJson)})
    append_little(head, std::uint32_t(word));
  head += json;
  append_little(head, std::uint32_t(binary_bytes));
  append_little(head, kGlbBinary);
  return head;
}

float linear_of(float srgb) {
  const float c = clamp_to(srgb, 0.0f, 1.0f);
  return c <= 0.04045f ? c / 12.92f : std::pow((c + 0.055f) / 1.055f, 2.4f);
}

float srgb_of(float linear) {
  const float c = clamp_to(linear, 0.0f, 1.0f);
  return c <= 0.0031308f ? 12.92f * c : 1.055f * std::pow(c, 1 / 2.4f) - 0.055f;
}

void write_glb(ByteSink& sink, const GaussianModel& model) {
  const std::size_t count = model.gaussians.count();
  GS_CHECK(count > 0);
  const std::vector<Attribute> attributes = attributes_of(model);
  std::uint64_t binary_bytes = 0;  // a multiple of 4, as every row is
  for (const Attribute& attribute : attributes) binary_bytes += count * attribute.row_bytes;
  const std::string head = glb_head(document_of(model, attributes).dump(), binary_bytes);
  if (head.size() + binary_bytes > std::numeric_limits<std::uint32_t>::max())
    throw Error(
        fmt::format("cannot write {}: {} Gaussians take more than the 4 GiB that a .glb "
                    "can have; choose .ply, .sog or .spz, or a lower --sh-degree",
                    sink.name(), count));
  sink.write(head);
  for (const Attribute& attribute : attributes) {
    std::vector<std::uint8_t> rows(count * attribute.row_bytes);
    for (std::size_t i = 0; i < count; ++i) attribute.fill(i, &rows[i * attribute.row_bytes]);
    sink.write(rows.data(), rows.size());
  }
}

}  // namespace gs
