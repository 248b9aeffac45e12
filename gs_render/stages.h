// SPDX-License-Identifier: Apache-2.0
// The scalar stages in pipeline order: the table of contents. Each stage reads what the earlier
// ones left in the RenderPass and in ScalarScratch, and fills its own fields. Stages 5 (loss), 8
// (Adam), 9 (rows) and 10 (Morton order) are training's, in gs_train.
#pragma once

#include <vector>

#include "gs_core/camera.h"
#include "gs_core/gaussians.h"
#include "gs_core/math/density/growth.h"
#include "gs_core/math/pose/pose.h"
#include "gs_core/math/spacetime/spacetime_splat.h"
#include "gs_render/render_pass.h"

namespace gs {

/// What the scalar stages hand to each other besides the RenderPass.
struct ScalarScratch final : BackendScratch {
  // 2 instances                        in depth order of their Gaussians
  // (N)  where a visible Gaussian's instances begin; it has tile_counts of them
  Buffer<std::uint32_t> first_instance;
  Buffer<std::uint32_t>
      instance_tiles;  // (I)  tile of each instance; of masked ones, the number of tiles
  Buffer<std::uint32_t> instance_splats;  // (I)  its Gaussian
  Buffer<std::uint32_t> sort_scratch;     // (V)  of the depth sort

  // 3 tile order
  // (I)  the instances' numbers, in the order of RenderPass::tile_splats
  Buffer<std::uint32_t> tile_instances;

  // 6 blend backward
  // (I)  each instance's share, summed per splat in a fixed order
  Buffer<SplatGradient> instance_gradients;
  // (I)  by the mean, absolute values; only with absolute_gradient
  Buffer<Vec2f> absolute_gradients;
  // (I)  each instance's share; only with a fragment_statistic, and after blend_values()
  Buffer<FragmentSums> fragment_sums;
  Buffer<SurfaceRow> surface_gradients;  // (I)  each instance's share; only of surfaces

  explicit ScalarScratch(Memory& memory)
      : first_instance(memory), instance_tiles(memory), instance_splats(memory),
        sort_scratch(memory), tile_instances(memory), instance_gradients(memory),
        absolute_gradients(memory), fragment_sums(memory), surface_gradients(memory) {}
};

/// 1  Activate, cull, project, color: one splat per Gaussian, and how many tiles it hits.
void preprocess(const GaussiansSpan& gaussians, const Camera& camera,
                const RenderSettings& settings, RenderPass& pass);

/// 2  Order the visible Gaussians near to far; then one instance per (splat, tile), in that order.
void create_instances(const RenderSettings& settings, RenderPass& pass);

/// 3  Order the instances by tile, stably, so that each tile's list runs front to back.
void sort_by_tile(RenderPass& pass);

/// 4  Blend each tile's list front to back over the background.
void blend(const RenderSettings& settings, RenderPass& pass);

/// 6  From dL/d(picture) to dL/d(splat) of every instance, front to back again.
void blend_backward(const RenderSettings& settings, const PictureGradient& dL, RenderPass& pass);

/// After 4, in a score pass: sums values of the pixels, (H, W), over the fragments of each instance
/// (FragmentSums); fragment_sums_of() has those of a Gaussian.
void blend_values(const RenderSettings& settings, Span<const float> values, RenderPass& pass);

/// After 4  blend_surface.cpp: finds the surfaces of visible Gaussians, and sums them over the
/// fragments of each pixel. Does nothing unless settings.blends_surface.
void blend_surface(const GaussiansSpan& gaussians, const Camera& camera,
                   const RenderSettings& settings, RenderPass& pass);
/// After 6  blend_surface.cpp: adds what dL/d(surface_image) makes of each instance to its gradient,
/// and keeps dL/d(surface_rows) for surface_backward().
void blend_surface_backward(const RenderSettings& settings, Span<const SurfaceRow> dL,
                            RenderPass& pass);
/// After 7  blend_surface.cpp: pulls dL/d(surface_rows) back, and adds it to the gradients.
void surface_backward(const GaussiansSpan& gaussians, const Camera& camera,
                      const RenderSettings& settings, const RenderPass& pass,
                      const GaussiansSpan& gradients);

/// 7  Sum each splat's instances and pull the gradient back to the stored parameters.
void preprocess_backward(const GaussiansSpan& gaussians, const Camera& camera,
                         const RenderSettings& settings, const RenderPass& pass,
                         const GaussiansSpan& gradients, Span<Vec2f> dL_dmean2d);

/// 7  The same gradient of every splat, pulled back to the camera and summed over all Gaussians, in
/// an order of its own. Only runs that refine poses have this stage (camera_gradient.cpp).
CameraGradient<double> camera_gradient(const GaussiansSpan& gaussians, const Camera& camera,
                                       const RenderSettings& settings, const RenderPass& pass);

/// dL/d(splat) of a visible Gaussian that blend_backward() left, summed over its instances in
/// order.
SplatGradient splat_gradient_of(const RenderPass& pass, std::size_t i);
/// The gradient by its mean, of absolute values; only with RenderSettings::absolute_gradient.
Vec2f absolute_gradient_of(const RenderPass& pass, std::size_t i);
/// The sums over the fragments of a visible Gaussian that blend_backward() or blend_values() left, of
/// all its instances in order.
FragmentSums fragment_sums_of(const RenderPass& pass, std::size_t i);

/// Row i of the Gaussians, as the formulas take it.
inline GaussianParameters<float> parameters_of(const GaussiansSpan& gaussians, std::size_t i) {
  return {gaussians.mean[i],
          gaussians.log_scale[i],
          gaussians.rotation[i],
          gaussians.logit_opacity[i],
          gaussians.sh0[i],
          gaussians.sh_rest[i].coefficient,
          gaussians.has_filter ? gaussians.filter_scale[i] : 0.0f};
}
inline SpacetimeParameters<float> spacetime_parameters_of(const GaussiansSpan& gaussians,
                                                          std::size_t i) {
  return {parameters_of(gaussians, i), gaussians.right_rotation[i], gaussians.time_mean[i],
          gaussians.log_time_scale[i]};
}

}  // namespace gs
