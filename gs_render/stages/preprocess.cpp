// SPDX-License-Identifier: Apache-2.0
// Stage 1: one splat per Gaussian; see gs_core/math/render/splat.h for the formulas, and
// spacetime_splat.h for those of Gaussians in space and time.
#include "gs_core/threads/parallel.h"
#include "gs_render/renderer.h"
#include "gs_render/stage_clock.h"
#include "gs_render/stages.h"

namespace gs {
namespace {

ProjectedGaussian<float> project_row(const GaussiansSpan& gaussians, std::size_t i,
                                     const Camera& camera, const RenderSettings& settings) {
  if (gaussians.has_time)
    return project_gaussian(camera, spacetime_parameters_of(gaussians, i), camera.time, settings);
  return project_gaussian(camera, parameters_of(gaussians, i), settings);
}

}  // namespace

void preprocess(const GaussiansSpan& gaussians, const Camera& camera,
                const RenderSettings& settings, RenderPass& pass) {
  const HostStage stage("preprocess");
  const std::size_t count = gaussians.mean.size;
  pass.begin(camera, count);
  if (settings.order == RenderOrder::pixel) {
    check_has_rays(gaussians, camera);
    pass.ray_depths.resize_discard(count);
  }

  parallel_for(count, 512, [&](std::size_t i) {
    pass.tile_counts[i] = 0;
    const ProjectedGaussian<float> projected = project_row(gaussians, i, camera, settings);
    if (!projected.is_visible) return;
    const Splat& splat = projected.splat;
    const Rect pixels = pixels_of(settings.bounds, splat.mean2d, projected.cov2d, splat.cutoff,
                                  pass.tiles_x, pass.tiles_y);
    if (pixels.empty()) return;
    std::uint32_t hits = 0;
    for_each_hit_tile(splat.mean2d, splat.conic, tile_cutoff(settings.bounds, splat.cutoff), pixels,
                      [&](int, int) { ++hits; });
    pass.splats[i] = splat;
    pass.pixel_rects[i] = pixels;
    pass.tile_counts[i] = hits;
    if (!pass.ray_depths.empty())
      pass.ray_depths[i] = ray_depth(camera, parameters_of(gaussians, i));
  });
}

}  // namespace gs
