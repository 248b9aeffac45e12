// SPDX-License-Identifier: Apache-2.0
// A model and its views as a layer.
#include <spdlog/fmt/fmt.h>

#include <algorithm>
#include <array>
#include <cctype>
#include <limits>

#include "gs_core/error.h"
#include "gs_model/formats/coding/frame.h"
#include "gs_model/formats/coding/quantize.h"
#include "gs_model/formats/usd/usd.h"
#include "gs_model/formats/usd/usd_prims.h"

namespace gs {
namespace {

constexpr float kSupport = 3;     // standard deviations that the kernel reaches, by the schema
constexpr float kFilmWidth = 36;  // of a camera, in tenths of a world unit; only ratios matter
constexpr float kNearest = 0.01f, kFarthest = 100'000;  // that a camera shows, world units
constexpr std::size_t kPackageAlignment = 64;

// Values of attributes.
UsdValue floats(std::string type, std::vector<float> values) {
  return {std::move(type), std::move(values)};
}
UsdValue doubles(std::string type, std::vector<double> values) {
  return {std::move(type), {}, std::move(values)};
}
UsdValue words(std::string type, std::vector<std::string> values) {
  return {std::move(type), {}, {}, std::move(values)};
}

/// The values of fill(i, add) for each Gaussian i.
template <class Fill>
UsdValue rows_of(std::string type, const Gaussians& g, std::size_t width, Fill&& fill) {
  UsdValue value{std::move(type)};
  value.floats.reserve(g.count() * width);
  for (std::size_t i = 0; i < g.count(); ++i)
    for (const float number : fill(i)) value.floats.push_back(number);
  return value;
}

std::array<float, 3> numbers(const Vec3f& v) { return {v.x, v.y, v.z}; }

UsdValue extent_of(const Gaussians& g, const UsdValue& positions, const UsdValue& scales) {
  constexpr float kMost = std::numeric_limits<float>::max();
  std::vector<float> extent = {kMost, kMost, kMost, -kMost, -kMost, -kMost};
  for (std::size_t i = 0; i < g.count(); ++i) {
    const float* scale = &scales.floats[3 * i];
    const float radius = std::min(kSupport * std::max({scale[0], scale[1], scale[2]}), kMost);
    for (std::size_t axis = 0; axis < 3; ++axis) {
      const float center = positions.floats[3 * i + axis];
      extent[axis] = std::max(std::min(extent[axis], center - radius), -kMost);
      extent[3 + axis] = std::min(std::max(extent[3 + axis], center + radius), kMost);
    }
  }
  return floats("float3[]", extent);
}

UsdPrim gaussians_prim(const GaussianModel& model) {
  const Gaussians& g = model.gaussians;
  const int rest = sh_rest_count(model.sh_degree);
  UsdPrim prim{"Gaussians", "ParticleField3DGaussianSplat", {"ColorSpaceAPI"}};
  const auto add = [&](std::string name, UsdValue value, bool is_uniform = false) {
    prim.attributes.push_back({std::move(name), std::move(value), is_uniform});
  };
  UsdValue positions =
      rows_of("point3f[]", g, 3, [&](std::size_t i) { return numbers(g.mean[i] * kHalfTurnZ); });
  UsdValue scales = rows_of("float3[]", g, 3, [&](std::size_t i) {
    const Vec3f& s = g.log_scale[i];
    return std::array{finite_exp(s.x), finite_exp(s.y), finite_exp(s.z)};
  });
  add("colorSpace:name", words("token", {"srgb_rec709_display"}), true);
  add("extent", extent_of(g, positions, scales));
  add("positions", std::move(positions));
  add("orientations", rows_of("quatf[]", g, 4, [&](std::size_t i) {
        const Quatf& q = g.rotation[i];  // (0 0 0 1) q, as in a .glb
        return std::array{-q.z, -q.y, q.x, q.w};
      }));
  add("scales", std::move(scales));
  add("opacities", rows_of("float[]", g, 1,
                           [&](std::size_t i) { return std::array{sigmoid(g.logit_opacity[i])}; }));
  add("radiance:sphericalHarmonicsDegree", doubles("int", {double(model.sh_degree)}), true);
  UsdValue sh{"float3[]"};
  sh.element_size = 1 + rest;
  sh.floats.reserve(g.count() * std::size_t(3 * sh.element_size));
  for (std::size_t i = 0; i < g.count(); ++i)
    for (int k = -1; k < rest; ++k)
      for (const float number :
           numbers(k < 0 ? g.sh0[i] : sh_sign(k, kHalfTurnZ) * g.sh_rest[i].coefficient[k]))
        sh.floats.push_back(number);
  add("radiance:sphericalHarmonicsCoefficients", std::move(sh));
  add("projectionModeHint", words("token", {"perspective"}), true);
  add("sortingModeHint", words("token", {"zDepth"}), true);
  if (model.antialiased)
    prim.attributes.push_back({"gemsplat:antialiased", doubles("bool", {1}), false, true});
  add_world_offset(prim, model.world_offset);
  return prim;
}

/// A pinhole: USD's cameras look along -z, with y up, and matrices are for rows (x y z 1).
UsdPrim camera_prim(std::size_t index, const NamedView& view) {
  const Camera& camera = view.camera;
  std::string name = fmt::format("view_{}_{}", index, view.name);
  for (char& c : name)
    if (!std::isalnum(static_cast<unsigned char>(c)) || c & 0x80) c = '_';
  const auto world_of = [](const Vec3f& v) { return v * kHalfTurnZ; };
  const Mat3<float>& R = camera.cam_from_world_rotation;
  const Vec3f axes[] = {world_of(R.row0), world_of(-R.row1), world_of(-R.row2),
                        world_of(camera.position())};
  std::vector<double> matrix;
  for (const Vec3f& axis : axes)
    matrix.insert(matrix.end(), {axis.x, axis.y, axis.z, &axis == &axes[3] ? 1.0 : 0.0});
  const auto width = float(camera.width), height = float(camera.height);
  const float focal = kFilmWidth * camera.fx / width, per_row = focal / camera.fy;
  UsdPrim prim{name, "Camera"};
  const auto add = [&](std::string attribute, UsdValue value, bool is_uniform = false) {
    prim.attributes.push_back({std::move(attribute), std::move(value), is_uniform});
  };
  add("clippingRange", floats("float2", {kNearest, kFarthest}));
  add("focalLength", floats("float", {focal}));
  add("horizontalAperture", floats("float", {kFilmWidth}));
  add("horizontalApertureOffset", floats("float", {(width / 2 - camera.cx) * kFilmWidth / width}));
  add("verticalAperture", floats("float", {height * per_row}));
  add("verticalApertureOffset", floats("float", {(camera.cy - height / 2) * per_row}));
  add("xformOp:transform", doubles("matrix4d", matrix));
  add("xformOpOrder", words("token[]", {"xformOp:transform"}), true);
  return prim;
}

UsdLayer layer_of(const GaussianModel& model, const std::vector<NamedView>& views) {
  GS_CHECK(model.gaussians.count() > 0);
  return usd_scene(gaussians_prim(model), views);
}

}  // namespace

void add_world_offset(UsdPrim& prim, const Vec3d& offset) {
  if (offset != Vec3d(0.0))
    prim.attributes.push_back(
        {"gemsplat:worldOffset", doubles("double3", {offset.x, offset.y, offset.z}), false, true});
}

UsdLayer usd_scene(UsdPrim prim, const std::vector<NamedView>& views) {
  UsdPrim scene{"Scene", "Xform", {}, {}, {std::move(prim)}};
  UsdPrim cameras{"Cameras", "Scope"};
  for (std::size_t i = 0; i < views.size(); ++i)
    if (!views[i].camera.has_lens()) cameras.children.push_back(camera_prim(i, views[i]));
  if (!cameras.children.empty()) scene.children.push_back(std::move(cameras));
  return {"Y", {std::move(scene)}};
}

std::string usd_package(const std::vector<ZipEntry>& files) {
  return zip_of(files, false, kPackageAlignment);
}

void write_usda(ByteSink& sink, const GaussianModel& model, const std::vector<NamedView>& views) {
  write_usda(sink, layer_of(model, views));
}

void write_usdc(ByteSink& sink, const GaussianModel& model, const std::vector<NamedView>& views) {
  write_usdc(sink, layer_of(model, views));
}

void write_usdz(ByteSink& sink, const GaussianModel& model, const std::vector<NamedView>& views) {
  MemorySink layer(sink.name());
  write_usdc(layer, layer_of(model, views));
  sink.write(usd_package({{"model.usdc", std::move(layer.text)}}));
}

}  // namespace gs
