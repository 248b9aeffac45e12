// SPDX-License-Identifier: Apache-2.0
#include "gs_render/fusion/surface_depth.h"

#include <cmath>
#include <limits>

#include "gs_core/math/render/surface.h"
#include "gs_core/threads/parallel.h"

namespace gs {
namespace {

constexpr float kDepthWindow = 0.01f;      // of the inverse depth at the crossing
constexpr float kMostLight = 0.45f;        // that a surface lets through
constexpr float kOpenLight = 0.9f;         // more is left where nothing is
constexpr std::size_t kRowsPerTask = 256;  // visible Gaussians

/// What the walk over fragments reads of a pass, in host memory.
struct HostPass {
  std::vector<Splat> splats;
  std::vector<Rect> rects;
  std::vector<std::uint32_t> counts, lists, ranges;
  std::vector<SplatPlane<float>> planes;  // (N) of visible Gaussians

  HostPass(const RenderPass& pass, const Gaussians& g, const Camera& camera)
      : splats(pass.splats.download()), rects(pass.pixel_rects.download()),
        counts(pass.tile_counts.download()), lists(pass.tile_splats.download()),
        ranges(pass.tile_ranges.download()), planes(splats.size()) {
    parallel_for(splats.size(), kRowsPerTask, [&](std::size_t i) {
      if (counts[i] == 0) return;
      const Vec3f variances =
          filtered_variance(variance(g.log_scale[i]), g.has_filter ? g.filter_scale[i] : 0.0f);
      planes[i] =
          splat_plane(camera, to_camera(camera, g.mean[i]),
                      covariance(rotation_matrix(g.rotation[i]), variances), splats[i].conic);
    });
    for (std::uint32_t& entry : lists) entry = gaussian_of<>(entry);
  }
};

/// Calls visit(inverse depth, weight, light left behind it) for the fragments of a pixel, front to
/// back, until it returns false or no light is left. Returns the light that is left.
template <class Visit>
float walk(const HostPass& host, std::size_t tile, int x, int y, BlendRule rule, Visit&& visit) {
  float light = 1;
  for (std::uint32_t k = host.ranges[tile]; k < host.ranges[tile + 1]; ++k) {
    const std::uint32_t i = host.lists[k];
    const Rect& rect = host.rects[i];
    if (x < int(rect.x_begin) || x >= int(rect.x_end) || y < int(rect.y_begin) ||
        y >= int(rect.y_end))
      continue;
    const Splat& splat = host.splats[i];
    const float dx = float(x) + 0.5f - splat.mean2d.x, dy = float(y) + 0.5f - splat.mean2d.y;
    const float exponent = fragment_exponent(splat.conic, dx, dy);
    if (exponent < -splat.cutoff) continue;
    const float gaussian = exp_fragment(max_of(exponent, kMinExponent));
    const float alpha = rule == BlendRule::classic
                            ? fragment_alpha<BlendRule::classic>(splat.opacity, gaussian)
                            : fragment_alpha<BlendRule::faster_gs>(splat.opacity, gaussian);
    const SplatPlane<float>& plane = host.planes[i];
    const float o = plane.at_mean + inner(plane.slope, Vec2f(dx, dy));
    const float weight = light * alpha;
    light -= weight;
    if (!visit(o, weight, light) || is_opaque(light)) break;
  }
  return light;
}

float inverse_depth_at(const HostPass& host, std::size_t tile, int x, int y, BlendRule rule) {
  float crossing = kUnknownDepth;
  const float left = walk(host, tile, x, y, rule, [&](float o, float, float light) {
    if (light < 0.5f) crossing = o;
    return light >= 0.5f;
  });
  if (left > kOpenLight) return kOpenPixel;
  if (!(crossing > 0)) return kUnknownDepth;
  float sum = 0, weights = 0;
  const float end = walk(host, tile, x, y, rule, [&](float o, float weight, float) {
    if (std::abs(o - crossing) <= kDepthWindow * crossing) sum += weight * o, weights += weight;
    return true;
  });
  return end <= kMostLight ? sum / weights : kUnknownDepth;
}

}  // namespace

ImageF surface_inverse_depth(const RenderPass& pass, const Gaussians& gaussians,
                             const Camera& camera, const RenderSettings& settings) {
  const HostPass host(pass, gaussians, camera);
  ImageF result(pass.width, pass.height, 1);
  parallel_for(pass.tile_count(), 1, [&](std::size_t tile) {
    const int x0 = int(tile % pass.tiles_x) * kTileWidth;
    const int y0 = int(tile / pass.tiles_x) * kTileHeight;
    for (int y = y0; y < std::min(y0 + kTileHeight, pass.height); ++y)
      for (int x = x0; x < std::min(x0 + kTileWidth, pass.width); ++x)
        result.at(x, y, 0) = inverse_depth_at(host, tile, x, y, settings.blend_rule);
  });
  return result;
}

}  // namespace gs
