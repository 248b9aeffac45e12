// SPDX-License-Identifier: Apache-2.0
// Reads a .glb in three steps: the container (glb_file.h), the primitives of its scene
// (glb_scene.h), and here their Gaussians, brought together.
#include <spdlog/fmt/fmt.h>

#include <algorithm>
#include <cmath>
#include <map>

#include "gs_core/system/byte_reader.h"
#include "gs_model/formats/coding/count_check.h"
#include "gs_model/formats/coding/finite_rows.h"
#include "gs_model/formats/coding/frame.h"
#include "gs_model/formats/coding/quantize.h"
#include "gs_model/formats/glb/glb.h"
#include "gs_model/formats/glb/glb_scene.h"
#include "gs_model/formats/spz/spz.h"

namespace gs {
namespace {

using Path = std::filesystem::path;

/// A logit between those of opacities that a float tells from 0 and from 1.
float finite_logit(float opacity) {
  constexpr float kLeast = 1e-7f;
  const double inside = clamp_to(double(opacity), double(kLeast), 1 - double(kLeast));
  return std::isfinite(opacity) ? float(logit(inside)) : opacity;
}

GaussianModel plain_model(const GlbFile& glb, const SortedJson& primitive) {
  const SortedJson* attributes = GlbFile::find(primitive, "attributes");
  if (!attributes) glb.fail("lacks attributes");
  const auto has = [&](const std::string& name) {
    return GlbFile::find(*attributes, name.c_str());
  };
  const auto accessor = [&](const std::string& name, std::size_t width) {
    return GlbAccessor(glb, glb.number(*attributes, name.c_str()), width);
  };
  const std::string prefix = std::string(kGlbGaussians) + ":";
  const GlbAccessor mean = accessor("POSITION", 3), rotation = accessor(prefix + "ROTATION", 4),
                    scale = accessor(prefix + "SCALE", 3),
                    opacity = accessor(prefix + "OPACITY", 1);
  std::vector<GlbAccessor> sh = {accessor(prefix + "SH_DEGREE_0_COEF_0", 3)};
  int degree = 0;
  while (degree < kMaxShDegree && has(fmt::format("{}SH_DEGREE_{}_COEF_0", prefix, degree + 1))) {
    ++degree;
    for (int c = 0; c < 2 * degree + 1; ++c)
      sh.push_back(accessor(fmt::format("{}SH_DEGREE_{}_COEF_{}", prefix, degree, c), 3));
  }
  const std::size_t count = mean.count();
  bool same = rotation.count() == count && scale.count() == count && opacity.count() == count;
  for (const GlbAccessor& coefficient : sh) same &= coefficient.count() == count;
  if (!same) glb.fail("has attributes of different lengths");
  check_count(glb.path(), count, glb.bytes());
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

void check_color_space(const SortedJson& splatting, const Path& path) {
  const SortedJson* space = GlbFile::find(splatting, "colorSpace");
  if (space && *space == "lin_rec709_display")
    cannot_read(path,
                "its colors are linear (lin_rec709_display), but gemsplat blends display colors; "
                "export it with the color space srgb_rec709_display");
}

GaussianModel model_of(const GlbFile& glb, const SortedJson& primitive) {
  const SortedJson& extensions = *gaussians_in(primitive);
  const SortedJson* splatting = GlbFile::find(extensions, kGlbGaussians);
  if (splatting) check_color_space(*splatting, glb.path());
  const SortedJson* inner = splatting ? GlbFile::find(*splatting, "extensions") : nullptr;
  const SortedJson* spz = inner ? spz_in(*inner) : nullptr;
  if (!spz) spz = spz_in(extensions);
  if (spz) {
    // The draft's frame is left, up, forward; older files have the numbers of the .spz as they are.
    const bool is_draft = splatting && GlbFile::find(*splatting, "kernel");
    return spz_model(glb.path(), glb.view(glb.number(*spz, "bufferView")),
                     is_draft ? kHalfTurnX : kHalfTurnZ);
  }
  GaussianModel model = plain_model(glb, primitive);
  const SortedJson* extras = GlbFile::find(primitive, "extras");
  const SortedJson* antialiased = extras ? GlbFile::find(*extras, "antialiased") : nullptr;
  model.antialiased = antialiased && *antialiased == true;
  return model;
}

/// Moves a model as its node says, whose axes are glTF's.
void place(GaussianModel& model, const GlbInstance& instance) {
  const Mat4d half_turn = diagonal(kHalfTurnZ);
  ModelTransform transform =
      transform_of(multiply(multiply(half_turn, instance.scene_from_primitive), half_turn));
  Quat<double>& turn = transform.turn;  // of a matrix of floats
  const double length = std::sqrt(squared_norm(turn));
  turn = {turn.w / length, turn.x / length, turn.y / length, turn.z / length};
  transform_model(model, transform);
  model.world_offset = instance.world_offset;
}

void append(const GaussianModel& part, GaussianModel& model) {
  const std::size_t before = model.gaussians.count(), more = part.gaussians.count();
  model.gaussians.resize(before + more);
  copy_rows(part.gaussians, 0, more, model.gaussians, before);
  model.sh_degree = std::max(model.sh_degree, part.sh_degree);
  model.antialiased = model.antialiased || part.antialiased;
}

/// Throws Error where the instances together hold more Gaussians than a file of this size may, which
/// many nodes of one primitive do. Nothing but one primitive at a time is in memory meanwhile.
void check_sum(const GlbFile& glb, const std::vector<GlbInstance>& instances, std::size_t bytes) {
  std::map<const SortedJson*, std::uint64_t> counts;
  std::uint64_t sum = 0;
  for (const GlbInstance& instance : instances) {
    const auto [count, is_new] = counts.emplace(instance.primitive, 0);
    if (is_new) count->second = model_of(glb, *instance.primitive).gaussians.count();
    check_count(glb.path(), sum += count->second, bytes);
  }
}

}  // namespace

GaussianModel read_glb(const Path& path) {
  ByteReader reader(path);
  const std::size_t size = reader.size();
  const GlbFile glb(path, {reinterpret_cast<const char*>(reader.take(size)), size});
  GaussianModel model;
  bool is_first = true;
  const std::vector<GlbInstance> instances = glb_instances(glb);
  if (instances.size() > 1) check_sum(glb, instances, size);
  for (const GlbInstance& instance : instances) {
    GaussianModel part = model_of(glb, *instance.primitive);
    place(part, instance);
    if (is_first)
      model = std::move(part);
    else
      append(part, model);
    is_first = false;
  }
  return model;
}

}  // namespace gs
