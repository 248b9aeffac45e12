// SPDX-License-Identifier: Apache-2.0
// Stages 4 and 6 for photos with a depth map: the same blending with the color (z, 1, 0), where z
// is the depth of a Gaussian. The picture is then (sum w z, sum w, 0), with the weights of the
// colors.
#include "gs_core/threads/parallel.h"
#include "gs_render/stages.h"

namespace gs {
namespace {

// While it lives, the splats of a pass have depths for colors, and the pass's picture is `planes`.
class DepthColors {
 public:
  DepthColors(RenderPass& pass, Buffer<float>& planes)
      : pass_(pass), planes_(planes), colors_(pass.splats.size(), host_memory()) {
    pass_.image.swap(planes_);
    parallel_for(colors_.size(), kRowsAtATime, [&](std::size_t i) {
      if (!pass_.tile_counts[i]) return;
      colors_[i] = pass_.splats[i].color;
      pass_.splats[i].color = {pass_.depths[i], 1.0f, 0.0f};
    });
  }
  ~DepthColors() {
    parallel_for(colors_.size(), kRowsAtATime, [&](std::size_t i) {
      if (pass_.tile_counts[i]) pass_.splats[i].color = colors_[i];
    });
    pass_.image.swap(planes_);
  }
  DepthColors(const DepthColors&) = delete;
  DepthColors& operator=(const DepthColors&) = delete;

 private:
  static constexpr std::size_t kRowsAtATime = 4096;
  RenderPass& pass_;
  Buffer<float>& planes_;
  Buffer<Vec3f> colors_;
};

RenderSettings depth_settings(RenderSettings settings) {
  settings.background = Vec3f(0);
  settings.fragment_statistic = FragmentStatistic::none;
  return settings;
}

}  // namespace

void blend_depth(const RenderSettings& settings, RenderPass& pass, Buffer<float>& planes) {
  const DepthColors colors(pass, planes);
  blend(depth_settings(settings), pass);
}

void blend_depth_backward(const RenderSettings& settings, Span<const float> dL_dplanes,
                          Buffer<float>& planes, RenderPass& pass) {
  const DepthColors colors(pass, planes);
  blend_backward(depth_settings(settings), dL_dplanes, pass);
  ScalarScratch& scratch = pass.scratch<ScalarScratch>();
  scratch.depth_gradients.swap(scratch.instance_gradients);
  scratch.depth_absolute_gradients.swap(scratch.absolute_gradients);
}

void add_depth_gradients(RenderPass& pass) {
  ScalarScratch& scratch = pass.scratch<ScalarScratch>();
  const std::size_t count = scratch.depth_gradients.size();
  const bool has_absolute = !scratch.absolute_gradients.empty();
  parallel_for(count, 4096, [&](std::size_t i) {
    SplatGradient& sum = scratch.instance_gradients[i];
    const SplatGradient& more = scratch.depth_gradients[i];
    sum.mean2d += more.mean2d;
    sum.conic = {sum.conic.xx + more.conic.xx, sum.conic.xy + more.conic.xy,
                 sum.conic.yy + more.conic.yy};
    sum.opacity += more.opacity;
    sum.depth = more.color.x;
    if (has_absolute) scratch.absolute_gradients[i] += scratch.depth_absolute_gradients[i];
  });
  scratch.depth_gradients.resize_discard(0);
  scratch.depth_absolute_gradients.resize_discard(0);
}

}  // namespace gs
