// SPDX-License-Identifier: Apache-2.0
#include "gs_render/fusion/surface_depth.h"

#include <cmath>

#include "gs_core/threads/parallel.h"

namespace gs {
namespace {

constexpr std::size_t kRowsPerTask = 256;  // visible Gaussians

/// The planes of the visible Gaussians.   (N)
std::vector<SplatPlane<float>> planes_of(const RenderPass& pass, const GaussiansSpan& gaussians,
                                         const Camera& camera) {
  std::vector<SplatPlane<float>> planes(pass.tile_counts.size());
  parallel_for(planes.size(), kRowsPerTask, [&](std::size_t i) {
    if (pass.tile_counts[i] > 0) planes[i] = plane_of(gaussians, i, camera, pass.splats[i].conic);
  });
  return planes;
}

/// A tile and what the walk over its fragments reads.
struct TileFragments {
  const RenderPass& pass;
  const std::vector<SplatPlane<float>>& planes;
  std::uint32_t begin;  // of its list
  BlendRule rule;
};

/// Calls visit(inverse depth, weight, light left behind it) for the fragments that a pixel has
/// blended, front to back, until it returns false. Returns the light that is left.
template <class Visit>
float walk(const TileFragments& tile, int x, int y, Visit&& visit) {
  float light = 1;
  const RenderPass& pass = tile.pass;
  const std::uint32_t last = pass.last_instance[std::size_t(y) * pass.width + x];
  for (std::uint32_t k = tile.begin; k < tile.begin + last; ++k) {
    const std::uint32_t i = gaussian_of<>(pass.tile_splats[k]);
    const Rect& rect = pass.pixel_rects[i];
    if (x < int(rect.x_begin) || x >= int(rect.x_end) || y < int(rect.y_begin) ||
        y >= int(rect.y_end))
      continue;
    const Splat& splat = pass.splats[i];
    const float dx = float(x) + 0.5f - splat.mean2d.x, dy = float(y) + 0.5f - splat.mean2d.y;
    const float exponent = fragment_exponent(splat.conic, dx, dy);
    if (exponent < -splat.cutoff) continue;
    const float gaussian = exp_fragment(max_of(exponent, kMinExponent));
    const float alpha = tile.rule == BlendRule::classic
                            ? fragment_alpha<BlendRule::classic>(splat.opacity, gaussian)
                            : fragment_alpha<BlendRule::faster_gs>(splat.opacity, gaussian);
    const float o = tile.planes[i].at({dx, dy}), weight = light * alpha;
    light -= weight;
    if (!visit(o, weight, light)) break;
  }
  return light;
}

float inverse_depth_at(const TileFragments& tile, int x, int y) {
  float crossing = kUnknownDepth;
  const float left = walk(tile, x, y, [&](float o, float, float light) {
    if (light < 0.5f) crossing = o;
    return light >= 0.5f;
  });
  if (left > kOpenLight) return kOpenPixel;
  if (!(crossing > 0)) return kUnknownDepth;
  float sum = 0, weights = 0;
  const float end = walk(tile, x, y, [&](float o, float weight, float light) {
    if (!(std::abs(o - crossing) <= kDepthWindow * crossing)) return true;
    const float share = depth_share(weight, light);
    sum += share * o, weights += share;
    return true;
  });
  return end <= kMostLight ? sum / weights : kUnknownDepth;
}

}  // namespace

ImageF surface_inverse_depth(const RenderPass& pass, const GaussiansSpan& gaussians,
                             const Camera& camera, const RenderSettings& settings) {
  const std::vector<SplatPlane<float>> planes = planes_of(pass, gaussians, camera);
  ImageF result(pass.width, pass.height, 1);
  parallel_for(pass.tile_count(), 1, [&](std::size_t tile) {
    const TileFragments fragments{pass, planes, pass.tile_ranges[tile], settings.blend_rule};
    const int x0 = int(tile % pass.tiles_x) * kTileWidth;
    const int y0 = int(tile / pass.tiles_x) * kTileHeight;
    for (int y = y0; y < std::min(y0 + kTileHeight, pass.height); ++y)
      for (int x = x0; x < std::min(x0 + kTileWidth, pass.width); ++x)
        result.at(x, y, 0) = inverse_depth_at(fragments, x, y);
  });
  return result;
}

}  // namespace gs
