// SPDX-License-Identifier: Apache-2.0
// Stage 7: each visible Gaussian sums the gradients of its instances and pulls the sum back to its
// parameters.
#include "gs_core/threads/parallel.h"
#include "gs_render/stage_clock.h"
#include "gs_render/stages.h"

namespace gs {
namespace {

void write_row(const GaussiansSpan& gradients, std::size_t i,
               const GaussianGradient<float>& gradient) {
  gradients.mean[i] = gradient.mean;
  gradients.log_scale[i] = gradient.log_scale;
  gradients.rotation[i] = gradient.rotation;
  gradients.logit_opacity[i] = gradient.logit_opacity;
  gradients.sh0[i] = gradient.sh0;
}

void write_row(const GaussiansSpan& gradients, std::size_t i,
               const SpacetimeGradient<float>& gradient) {
  const SpacetimeShape<float>& shape = gradient.shape;
  gradients.mean[i] = shape.mean;
  gradients.log_scale[i] = shape.log_scale;
  gradients.rotation[i] = shape.rotations.left;
  gradients.logit_opacity[i] = shape.logit_opacity;
  gradients.sh0[i] = gradient.sh0;
  gradients.right_rotation[i] = shape.rotations.right;
  gradients.time_mean[i] = shape.time_mean;
  gradients.log_time_scale[i] = shape.log_time_scale;
}

}  // namespace

Vec2f absolute_gradient_of(const RenderPass& pass, std::size_t i) {
  const ScalarScratch& scratch = pass.scratch<ScalarScratch>();
  Vec2f sum(0.0f);
  const std::uint32_t begin = scratch.first_instance[i], end = begin + pass.tile_counts[i];
  for (std::uint32_t instance = begin; instance < end; ++instance)
    sum += scratch.absolute_gradients[instance];
  return sum;
}

SplatGradient splat_gradient_of(const RenderPass& pass, std::size_t i) {
  const ScalarScratch& scratch = pass.scratch<ScalarScratch>();
  SplatGradient sum{};
  const std::uint32_t begin = scratch.first_instance[i], end = begin + pass.tile_counts[i];
  for (std::uint32_t instance = begin; instance < end; ++instance) {
    const SplatGradient& part = scratch.instance_gradients[instance];
    sum.mean2d += part.mean2d;
    sum.conic = {sum.conic.xx + part.conic.xx, sum.conic.xy + part.conic.xy,
                 sum.conic.yy + part.conic.yy};
    sum.opacity += part.opacity;
    sum.color += part.color;
    sum.depth += part.depth;
  }
  return sum;
}

FragmentSums fragment_sums_of(const RenderPass& pass, std::size_t i) {
  const ScalarScratch& scratch = pass.scratch<ScalarScratch>();
  FragmentSums sum;
  const std::uint32_t begin = scratch.first_instance[i], end = begin + pass.tile_counts[i];
  for (std::uint32_t instance = begin; instance < end; ++instance)
    add_to(sum, scratch.fragment_sums[instance]);
  return sum;
}

void preprocess_backward(const GaussiansSpan& gaussians, const Camera& camera,
                         const RenderSettings& settings, const RenderPass& pass,
                         const GaussiansSpan& gradients, Span<Vec2f> dL_dmean2d) {
  const HostStage stage("preprocess backward");
  parallel_for(gaussians.mean.size, 512, [&](std::size_t i) {
    if (!pass.tile_counts[i]) {
      for_each_array([&](const char*, auto& rows) { rows[i] = {}; }, gradients);
      dL_dmean2d[i] = {};
      return;
    }
    const SplatGradient dL_dsplat = splat_gradient_of(pass, i);
    gradients.sh_rest[i] = {};  // degrees that are not in use have gradient 0
    Vec3f* const dL_dsh_rest = gradients.sh_rest[i].coefficient;
    if (gaussians.has_time)
      write_row(gradients, i,
                project_gaussian_vjp(camera, spacetime_parameters_of(gaussians, i), camera.time,
                                     settings, dL_dsplat, dL_dsh_rest));
    else
      write_row(gradients, i,
                project_gaussian_vjp(camera, parameters_of(gaussians, i), settings, dL_dsplat,
                                     dL_dsh_rest));
    dL_dmean2d[i] = settings.absolute_gradient ? absolute_gradient_of(pass, i) : dL_dsplat.mean2d;
  });
}

}  // namespace gs
