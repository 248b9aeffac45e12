// SPDX-License-Identifier: Apache-2.0
#include "gs_model/tiles/tile_file.h"

#include <spdlog/fmt/fmt.h>

#include <algorithm>

#include "gs_core/error.h"
#include "gs_core/system/files/atomic_file.h"
#include "gs_core/system/text/json.h"
#include "gs_core/system/version.h"
#include "gs_model/formats/glb/glb.h"
#include "gs_model/formats/spz/spz.h"

namespace gs {
namespace {

const AxisSigns kAsTheyAre{1, 1, 1};
constexpr int kSpzVersion = 3;  // CesiumJS 1.145 fails on 4, and 2 has coarser rotations
constexpr int kFloat = 5126, kUnsignedByte = 5121, kPoints = 0;  // numbers of glTF

/// The accessors say what the .spz holds; they have no bytes of their own.
class Attributes {
 public:
  explicit Attributes(std::size_t count) : count_(count) {}

  Json& add(const std::string& name, int component_type, const char* type) {
    indices_[name] = accessors_.size();
    accessors_.push_back({{"componentType", component_type}, {"count", count_}, {"type", type}});
    return accessors_.back();
  }
  const Json& indices() const { return indices_; }
  const Json& accessors() const { return accessors_; }

 private:
  std::size_t count_;
  Json indices_ = Json::object(), accessors_ = Json::array();
};

void add_bounds(Json& accessor, const Gaussians& g) {
  Vec3f low = g.mean[0], high = low;
  for (const Vec3f& mean : g.mean)
    for (int axis = 0; axis < 3; ++axis) {
      low[axis] = std::min(low[axis], mean[axis]);
      high[axis] = std::max(high[axis], mean[axis]);
    }
  accessor["min"] = {low.x, low.y, low.z};
  accessor["max"] = {high.x, high.y, high.z};
}

/// CesiumJS counts the SH attributes, and drops everything beyond degree 0 if degree 0 is listed.
Attributes attributes_of(const GaussianModel& model) {
  const std::string prefix = std::string(kTileGaussians) + ":";
  Attributes attributes(model.gaussians.count());
  add_bounds(attributes.add("POSITION", kFloat, "VEC3"), model.gaussians);
  attributes.add("COLOR_0", kUnsignedByte, "VEC4")["normalized"] = true;
  attributes.add(prefix + "ROTATION", kFloat, "VEC4");
  attributes.add(prefix + "SCALE", kFloat, "VEC3");
  for (int degree = 1; degree <= model.sh_degree; ++degree)
    for (int c = 0; c < 2 * degree + 1; ++c)
      attributes.add(fmt::format("{}SH_DEGREE_{}_COEF_{}", prefix, degree, c), kFloat, "VEC3");
  return attributes;
}

Json document_of(const GaussianModel& model, std::size_t spz_bytes) {
  const Attributes attributes = attributes_of(model);
  const Json splatting = {{"extensions", {{kTileSpz, {{"bufferView", 0}}}}}};
  const Json primitive = {{"mode", kPoints},
                          {"attributes", attributes.indices()},
                          {"extensions", {{kTileGaussians, splatting}}}};
  const Json extensions = Json::array({kTileGaussians, kTileSpz});
  const Json node = {{"mesh", 0}, {"matrix", {1, 0, 0, 0, 0, 0, -1, 0, 0, 1, 0, 0, 0, 0, 0, 1}}};
  const Json view = {{"buffer", 0}, {"byteOffset", 0}, {"byteLength", spz_bytes}};
  return {{"asset", {{"version", "2.0"}, {"generator", fmt::format("gemsplat {}", kVersion)}}},
          {"extensionsUsed", extensions},
          {"extensionsRequired", extensions},
          {"scene", 0},
          {"scenes", Json::array({{{"nodes", Json::array({0})}}})},
          {"nodes", Json::array({node})},
          {"meshes", Json::array({{{"primitives", Json::array({primitive})}}})},
          {"accessors", attributes.accessors()},
          {"bufferViews", Json::array({view})},
          {"buffers", Json::array({{{"byteLength", spz_bytes}}})}};
}

}  // namespace

std::uint64_t write_tile(const std::filesystem::path& path, const GaussianModel& model) {
  GS_CHECK(model.gaussians.count() > 0);
  std::string spz = spz_bytes(model, {kSpzVersion}, kAsTheyAre);
  const Json document = document_of(model, spz.size());
  spz.resize((spz.size() + 3) / 4 * 4, '\0');
  const std::string head = glb_head(document.dump(), spz.size());
  AtomicFile file(path);
  file.write(head);
  file.write(spz);
  file.commit();
  return head.size() + spz.size();
}

}  // namespace gs
