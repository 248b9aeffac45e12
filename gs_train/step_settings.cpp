// SPDX-License-Identifier: Apache-2.0
#include "gs_train/step_settings.h"

#include "gs_train/named_row.h"

namespace gs {
namespace {

template <class T>
struct Word {
  const char* name;
  T value;
};
constexpr Word<Truncation> kTruncations[] = {{"alpha", Truncation::alpha},
                                             {"sigma2", Truncation::sigma2},
                                             {"sigma3", Truncation::sigma3},
                                             {"sigma4", Truncation::sigma4}};
constexpr Word<TileBounds> kBounds[] = {
    {"exact", TileBounds::exact}, {"box", TileBounds::box}, {"square", TileBounds::square}};
constexpr Word<BlendRule> kBlendRules[] = {{"faster_gs", BlendRule::faster_gs},
                                           {"classic", BlendRule::classic}};
constexpr Word<bool> kUsesTensorCores[] = {{"gemm", true}, {"simt", false}};
constexpr Word<bool> kIsHalfPrecision[] = {{"full", false}, {"half", true}};
constexpr Word<float> kBackgrounds[] = {{"black", 0.0f}, {"white", 1.0f}, {"random", 0.0f}};

}  // namespace

RenderSettings render_settings(const Config& config) {
  const RenderConfig& render = config.render;
  RenderSettings settings;
  settings.sh_degree = config.model.sh_degree;
  settings.truncation = row_named(kTruncations, render.truncation, "render.truncation").value;
  settings.bounds = row_named(kBounds, render.bounds, "render.bounds").value;
  settings.blend_rule = row_named(kBlendRules, render.blend_rule, "render.blend_rule").value;
  settings.use_tensor_cores = row_named(kUsesTensorCores, render.blend, "render.blend").value;
  settings.half_precision = row_named(kIsHalfPrecision, render.precision, "render.precision").value;
  settings.background =
      Vec3f(row_named(kBackgrounds, render.background, "render.background").value);
  settings.antialias = render.antialias;
  settings.antialias_detach = render.antialias_detach;
  settings.near_plane = render.near_plane;
  settings.far_plane = render.far_plane;
  settings.deterministic = config.train.deterministic;
  settings.absolute_gradient = config.density.absolute_gradient;
  return settings;
}

LossSettings loss_settings(const Config& config) { return {config.loss.lambda_dssim}; }

}  // namespace gs
