// SPDX-License-Identifier: Apache-2.0
#include <spdlog/fmt/fmt.h>

#include <cmath>

#include "gs_model/formats/coding/count_check.h"
#include "gs_model/formats/coding/finite_rows.h"
#include "gs_model/formats/coding/frame.h"
#include "gs_model/formats/coding/quantize.h"
#include "gs_model/formats/glb/glb_file.h"

namespace gs {
namespace {

using Path = std::filesystem::path;

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

GaussianModel model_of(const GlbFile& glb, const SortedJson& primitive, std::uint64_t bytes) {
  const SortedJson* attributes = GlbFile::find(primitive, "attributes");
  if (!attributes) glb.fail("lacks attributes");
  const auto column = [&](const std::string& name, std::size_t width) {
    return GlbRows(glb, glb.number(*attributes, name.c_str()), width);
  };
  const std::string prefix = std::string(kGlbGaussians) + ":";
  const GlbRows mean = column("POSITION", 3), rotation = column(prefix + "ROTATION", 4),
                scale = column(prefix + "SCALE", 3), opacity = column(prefix + "OPACITY", 1);
  std::vector<GlbRows> sh = {column(prefix + "SH_DEGREE_0_COEF_0", 3)};
  int degree = 0;
  for (; degree < kMaxShDegree; ++degree) {
    const std::string name = fmt::format("{}SH_DEGREE_{}_COEF_", prefix, degree + 1);
    if (!GlbFile::find(*attributes, (name + "0").c_str())) break;
    for (int c = 0; c < 2 * degree + 3; ++c) sh.push_back(column(name + std::to_string(c), 3));
  }
  const std::size_t count = mean.count();
  bool same = rotation.count() == count && scale.count() == count && opacity.count() == count;
  for (const GlbRows& coefficient : sh) same &= coefficient.count() == count;
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
