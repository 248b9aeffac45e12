// SPDX-License-Identifier: Apache-2.0
#include "gs_render/render_settings.h"

#include "gs_core/density/growth_method.h"

namespace gs {

RenderSettings render_settings(const Config& config) {
  const RenderConfig& render = config.render;
  RenderSettings settings;
  settings.sh_degree = config.model.sh_degree;
  settings.truncation = render.truncation;
  settings.bounds = render.bounds;
  settings.use_tensor_cores = render.blend == BlendKernel::gemm;
  settings.deterministic = config.train.deterministic;
  settings.blend_rule = render.blend_rule;
  settings.order = render.order;
  settings.antialias = render.antialias;
  settings.antialias_detach = render.antialias_detach;
  settings.absolute_gradient = growth_method(config.density.strategy).absolute_gradient;
  settings.near_plane = render.near_plane;
  settings.far_plane = render.far_plane;
  if (render.background == Background::white) settings.background = Vec3f(1.0f);
  return settings;
}

}  // namespace gs
