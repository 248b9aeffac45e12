// SPDX-License-Identifier: Apache-2.0
// The Gaussians of layers as a model.
#include <spdlog/fmt/fmt.h>

#include <algorithm>
#include <cmath>

#include "gs_core/system/byte_reader.h"
#include "gs_core/system/log.h"
#include "gs_core/system/text/ascii.h"
#include "gs_core/system/text/foreign_text.h"
#include "gs_model/edit/model_transform.h"
#include "gs_model/formats/coding/finite_rows.h"
#include "gs_model/formats/coding/frame.h"
#include "gs_model/formats/coding/quantize.h"
#include "gs_model/formats/coding/zip_file.h"
#include "gs_model/formats/usd/crate.h"
#include "gs_model/formats/usd/usd.h"
#include "gs_model/formats/usd/usd_layer.h"

namespace gs {
namespace {

using Path = std::filesystem::path;

constexpr std::string_view kField = "ParticleField3DGaussianSplat";
const Mat4d kIdentity = translation(Vec3d(0.0));
const Mat4d kYUpFromZUp{{{1, 0, 0, 0}, {0, 0, 1, 0}, {0, -1, 0, 0}, {0, 0, 0, 1}}};

/// The prims of Gaussians in a stage, and where they stand in it.
struct Field {
  const UsdPrim* prim;
  Mat4d stage_from_prim;
};

/// The matrix of one step of a prim's transform. Steps that change nothing may be of any kind.
Mat4d step_of(const Path& path, const UsdPrim& prim, const std::string& step) {
  const UsdValue* value = prim.find(step);
  std::vector<double> v = value ? value->doubles : std::vector<double>();
  if (value && v.empty()) v.assign(value->floats.begin(), value->floats.end());
  if (step.starts_with("xformOp:transform") && v.size() == 16) {
    Mat4d matrix;
    for (int i = 0; i < 16; ++i) matrix.m[i % 4][i / 4] = v[std::size_t(i)];
    return matrix;
  }
  if (step.starts_with("xformOp:translate") && v.size() == 3)
    return translation({v[0], v[1], v[2]});
  const std::vector<double> unit(v.size(), 1), zero(v.size(), 0), still = {1, 0, 0, 0};
  const bool is_still = (step.starts_with("xformOp:scale") && v == unit) ||
                        (step.starts_with("xformOp:rotate") && v == zero) ||
                        (step.starts_with("xformOp:orient") && v == still);
  if (!is_still || v.empty())
    cannot_read(path,
                fmt::format("{} of the prim {} is no matrix and no shift, and gemsplat applies "
                            "no other transforms; apply it in the program that wrote the "
                            "file, and export it again",
                            shown_word(step), shown_word(prim.name)));
  return kIdentity;
}

void add_fields(const Path& path, const std::vector<UsdPrim>& prims, const Mat4d& stage_from_parent,
                std::vector<Field>& fields) {
  for (const UsdPrim& prim : prims) {
    std::vector<Field> inner;
    add_fields(path, prim.children, kIdentity, inner);
    if (prim.type == kField) inner.push_back({&prim, kIdentity});
    if (inner.empty()) continue;
    Mat4d stage_from_prim = stage_from_parent;
    if (const UsdValue* order = prim.find("xformOpOrder"))
      for (const std::string& step : order->words)
        stage_from_prim = multiply(stage_from_prim, step_of(path, prim, step));
    for (const Field& field : inner)
      fields.push_back({field.prim, multiply(stage_from_prim, field.stage_from_prim)});
  }
}

/// Floats of an attribute, or of the one with halfs where that alone has some. None where they are
/// fewer than `count` of them; then the schema has a default.
const std::vector<float>& floats_of(const Path& path, const UsdPrim& prim, std::string name,
                                    std::size_t count) {
  static const std::vector<float> kNone;
  for (const char* suffix : {"", "h"}) {
    const UsdValue* value = prim.find(name + suffix);
    if (prim.find(name + suffix + ".timeSamples"))
      cannot_read(path,
                  fmt::format("its {} change in time, and gemsplat reads Gaussians that rest; "
                              "export one moment",
                              name));
    if (!value || value->floats.empty()) continue;
    if (value->floats.size() >= count) return value->floats;
    log_warning("{}: {} are fewer than the positions; the default of USD takes their place",
                path.string(), name);
    return kNone;
  }
  return kNone;
}

int degree_of(const Path& path, const UsdPrim& prim) {
  const UsdValue* value = prim.find("radiance:sphericalHarmonicsDegree");
  if (!value || value->doubles.empty()) return 3;  // by the schema
  const double degree = value->doubles[0];
  if (degree != 0 && degree != 1 && degree != 2 && degree != 3)
    cannot_read(path, fmt::format("its SH degree is {}, and gemsplat knows 0 to 3; export it with "
                                  "degree 3",
                                  degree));
  return int(degree);
}

GaussianModel model_of(const Path& path, const UsdPrim& prim) {
  const UsdValue* space = prim.find("colorSpace:name");
  if (space && !space->words.empty() && space->words[0].starts_with("lin_"))
    cannot_read(
        path, fmt::format("its colors are linear ({}), but gemsplat blends display colors; export "
                          "it with the color space srgb_rec709_display",
                          shown_word(space->words[0])));
  const std::vector<float>& positions = floats_of(path, prim, "positions", 3);
  const std::size_t count = positions.size() / 3;
  if (count == 0) cannot_read(path, "its prim of Gaussians has no positions; export it again");
  const std::vector<float>&rotations = floats_of(path, prim, "orientations", 4 * count),
        &scales = floats_of(path, prim, "scales", 3 * count),
        &opacities = floats_of(path, prim, "opacities", count);
  int degree = degree_of(path, prim);
  const std::size_t each = std::size_t(3 * (1 + sh_rest_count(degree)));
  const std::vector<float>& sh =
      floats_of(path, prim, "radiance:sphericalHarmonicsCoefficients", each * count);
  if (sh.empty()) degree = 0;
  GaussianModel model{Gaussians(count, host_memory()), degree, false, false};
  const Gaussians& g = model.gaussians;
  model.gaussians.sh_rest.fill_zero();
  const auto vec3 = [](const float* v) { return Vec3f(v[0], v[1], v[2]); };
  for (std::size_t i = 0; i < count; ++i) {
    g.mean[i] = vec3(&positions[3 * i]) * kHalfTurnZ;
    g.log_scale[i] = scales.empty() ? Vec3f(0) : log_of_scale(vec3(&scales[3 * i]));
    // As (-z -y x w) of the PLY's rotation it was written: usd_write.cpp.
    const float* q = rotations.empty() ? nullptr : &rotations[4 * i];
    g.rotation[i] = q ? Quatf{q[3], q[2], -q[1], -q[0]} : Quatf{0, 0, 0, 1};
    normalize(&g.rotation[i].w);
    g.logit_opacity[i] = finite_logit(opacities.empty() ? 1 : opacities[i]);
    const float* f = sh.empty() ? nullptr : &sh[each * i];
    g.sh0[i] = f ? vec3(f) : Vec3f(0);
    for (int k = 0; k < sh_rest_count(degree); ++k)
      g.sh_rest[i].coefficient[k] = sh_sign(k, kHalfTurnZ) * vec3(f + 3 * (k + 1));
  }
  return model;
}

/// The layers of a package, or the one of a file. Their names point into the bytes.
std::vector<UsdLayer> layers_of(const Path& path, std::string_view bytes) {
  const auto layer_of = [&](std::string_view one) {
    return one.starts_with(kCrateMagic) ? parse_usdc(path, one) : parse_usda(path, one);
  };
  if (!bytes.starts_with("PK")) return {layer_of(bytes)};
  std::vector<UsdLayer> layers;
  for (const auto& [name, content] : zip_entries(path, bytes))
    if (const std::string end = lowercase(name);
        end.ends_with(".usda") || end.ends_with(".usdc") || end.ends_with(".usd"))
      layers.push_back(layer_of(content));
  return layers;
}

void place(const Path& path, GaussianModel& model, const Mat4d& stage_from_prim) {
  const Mat4d turn = diagonal(kHalfTurnZ);
  const Mat4d matrix = multiply(turn, multiply(stage_from_prim, turn));
  if (matrix == kIdentity) return;
  if (!is_similarity(matrix))
    cannot_read(
        path,
        "a transform of its prims shears, mirrors or scales unevenly; apply it in the program "
        "that wrote the file, and export it again");
  transform_model(model, transform_of(matrix));
  model.world_offset = Vec3d(0.0);
}

}  // namespace

GaussianModel read_usd(const Path& path) {
  ByteReader reader(path);
  const std::size_t size = reader.size();
  const std::vector<UsdLayer> layers =
      layers_of(path, {reinterpret_cast<const char*>(reader.take(size)), size});
  std::vector<Field> fields;
  for (const UsdLayer& layer : layers)
    add_fields(path, layer.prims, layer.up_axis == "Z" ? kYUpFromZUp : kIdentity, fields);
  if (fields.empty())
    cannot_read(path,
                fmt::format("its stage holds no prim of type {}; if it names other files, join "
                            "them with `usdcat --flatten`, else name a model of Gaussians",
                            kField));
  if (fields.size() > 1)
    cannot_read(
        path,
        "it holds several prims of Gaussians, and gemsplat reads one; join them in the program "
        "that wrote the file, and export it again");
  const UsdPrim& prim = *fields[0].prim;
  GaussianModel model = model_of(path, prim);
  if (const UsdValue* offset = prim.find("gemsplat:worldOffset")) {
    const std::vector<double>& v = offset->doubles;
    if (v.size() != 3 || !is_finite(Vec3d(v[0], v[1], v[2])))
      cannot_read(path, "its gemsplat:worldOffset is not 3 numbers; export it again");
    model.world_offset = {v[0], v[1], v[2]};
  }
  const UsdValue* antialiased = prim.find("gemsplat:antialiased");
  model.antialiased = antialiased && antialiased->doubles == std::vector<double>{1};
  place(path, model, fields[0].stage_from_prim);
  return model;
}

}  // namespace gs
