// SPDX-License-Identifier: Apache-2.0
#include "gs_eval/depth_error.h"

#include <algorithm>

#include "gs_core/error.h"
#include "gs_core/math/loss/depth_loss.h"
#include "gs_render/surface_renderer.h"

namespace gs {
namespace {

double mask_of(const View& view, std::size_t pixel) {
  return view.mask.empty() ? 1.0 : double(view.mask.pixels[pixel]) / 255;
}

// A rendered pixel counts as covered whole.
DepthSums sums_of(const ImageF& depth, const View& view, const DepthTarget* before) {
  DepthSums sums;
  for (std::size_t i = 0; i < depth.pixels.size(); ++i) {
    const float value = view.depth.pixels[i], D = depth.pixels[i];
    if (is_known_depth(value) && mask_of(view, i) > 0)
      add_to(sums, depth_sums_of_pixel(view.depth_kind, double(value), mask_of(view, i), double(D),
                                       D > 0 ? 1.0 : 0.0, before));
  }
  return sums;
}

}  // namespace

std::optional<double> depth_error(const ImageF& depth, const View& view) {
  if (view.depth.empty()) return std::nullopt;
  GS_CHECK(depth.pixels.size() == view.depth.pixels.size());
  const DepthTarget target = fitted_depth_target(
      view.depth_kind, 1, [&](const DepthTarget* before) { return sums_of(depth, view, before); });
  if (!(target.factor > 0)) return std::nullopt;
  double sum = 0, weight = 0;
  for (std::size_t i = 0; i < depth.pixels.size(); ++i) {
    const float value = view.depth.pixels[i];
    if (!is_known_depth(value)) continue;
    const double t = inverse_depth_of(view.depth_kind, target.fit, double(value));
    if (!(t > 0)) continue;
    sum += mask_of(view, i) * relative_depth_error(double(depth.pixels[i]), t);
    weight += mask_of(view, i);
  }
  if (!(weight > 0)) return std::nullopt;
  return sum / weight;
}

void measure_depth(Renderer& renderer, const Gaussians& gaussians, const std::vector<View>& views,
                   const RenderSettings& settings, Evaluation& evaluation) {
  if (gaussians.has_time || !have_depth_maps(views)) return;
  SurfaceRenderer surface(renderer, gaussians.span(), gaussians, settings);
  double sum = 0;
  std::size_t count = 0;
  for_each_with_photo(views, views.size(), [&](std::size_t, const View& view) {
    const auto measured =
        std::find_if(evaluation.views.begin(), evaluation.views.end(),
                     [&](const ViewMetrics& metrics) { return metrics.name == view.name; });
    if (view.depth.empty() || measured == evaluation.views.end()) return;
    measured->depth_error = depth_error(surface.depth(view.camera), view);
    if (!measured->depth_error) return;
    sum += *measured->depth_error;
    ++count;
  });
  if (count > 0) evaluation.depth_error = sum / double(count);
}

}  // namespace gs
