// SPDX-License-Identifier: Apache-2.0
// Stages 4 and 6 of the order by pixel: each pixel sorts all of its fragments by their depth along
// its own ray, and blends them. A fragment whose Gaussian has its most behind the eye is left out.
// Pixels of a tile are one after another, so that sums over them have a fixed order.
// Radl et al. 2024 (StopThePop), the full sort
#include "gs_render/stages/pixel_order.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <vector>

#include "gs_core/math/render/blend.h"
#include "gs_core/threads/parallel.h"
#include "gs_render/stages/tile_loop.h"

namespace gs {
namespace {

struct Fragment {
  float depth;             // along the ray
  std::uint32_t position;  // of the splat in the tile's list
  float dx, dy;            // from the splat's mean, pixels
  float gaussian;          // exp(E)
};
using TileFragments = std::array<std::vector<Fragment>, kTilePixels>;

// The fragments of each pixel, near to far; equal depths in the order of the list.
TileFragments sorted_fragments(const RenderPass& pass, const Tile& tile) {
  TileFragments of_pixels;
  for (std::uint32_t k = tile.begin; k < tile.end; ++k) {
    const std::uint32_t row = pass.tile_splats[k];
    const Splat& splat = pass.splats[row];
    for_each_lane_group(
        tile, pass.pixel_rects[row], splat.mean2d, [&](int first, float left, float dy) {
          for (int lane = 0; lane < kLanes; ++lane) {
            const float dx = left + float(lane);
            const float exponent = fragment_exponent(splat.conic, dx, dy);
            const float depth = pass.ray_depths[row].at(dx, dy);
            if (!(exponent >= -splat.cutoff && depth > 0.0f)) continue;
            of_pixels[first + lane].push_back(
                {depth, k - tile.begin, dx, dy, exp_fragment(max_of(exponent, kMinExponent))});
          }
        });
  }
  for (std::vector<Fragment>& fragments : of_pixels)
    std::stable_sort(fragments.begin(), fragments.end(),
                     [](const Fragment& a, const Fragment& b) { return a.depth < b.depth; });
  return of_pixels;
}

const Splat& splat_of(const RenderPass& pass, const Tile& tile, const Fragment& fragment) {
  return pass.splats[pass.tile_splats[tile.begin + fragment.position]];
}

template <BlendRule rule>
void blend_tile(const RenderSettings& settings, RenderPass& pass, const Tile& tile) {
  const TileFragments of_pixels = sorted_fragments(pass, tile);
  const std::size_t plane = pass.pixel_count();
  for (int pixel = 0; pixel < kTilePixels; ++pixel) {
    if (!tile.contains(pass, pixel)) continue;
    PixelState<float> state;
    float depth = 0;
    std::uint32_t blended = 0;
    for (const Fragment& fragment : of_pixels[pixel]) {
      const Splat& splat = splat_of(pass, tile, fragment);
      const float alpha = fragment_alpha<rule>(splat.opacity, fragment.gaussian);
      if (rule == BlendRule::classic && is_opaque(state.transmittance * (1.0f - alpha))) break;
      depth += state.transmittance * alpha * splat.depth;
      composite(state, splat.color, alpha);
      ++blended;
      if (rule == BlendRule::faster_gs && is_opaque(state.transmittance)) break;
    }
    const std::size_t to = tile.image_index(pass, pixel);
    const Vec3f color = state.color + state.transmittance * settings.background;
    for (int c = 0; c < 3; ++c) pass.image[c * plane + to] = color[c];
    pass.transmittance[to] = state.transmittance;
    pass.last_instance[to] = blended;
    if (settings.blends_depth) pass.depth_image[to] = depth;
  }
}

// What a pixel knows before the walk of the backward pass.
PixelBackwardState<float> backward_state(const RenderSettings& settings, const PictureGradient& dL,
                                         const RenderPass& pass, std::size_t from) {
  const std::size_t plane = pass.pixel_count();
  const float T = pass.transmittance[from];
  PixelBackwardState<float> state;
  for (int c = 0; c < 3; ++c) {
    state.color_behind[c] = pass.image[c * plane + from] - T * settings.background[c];
    state.dL_dcolor[c] = dL.image[c * plane + from];
  }
  state.background_term = -T * inner(state.dL_dcolor, settings.background);
  if (!dL.alpha.empty()) state.background_term += T * dL.alpha[from];
  return state;
}

// The shares of the instances of a tile.
struct TileShares {
  std::vector<SplatGradient> gradients;
  std::vector<Vec2f> absolute;
  std::vector<FragmentSums> sums;

  explicit TileShares(std::size_t count) : gradients(count), absolute(count), sums(count) {}
  void add(const Fragment& fragment, const Splat& splat, const CompositeGradient<float>& by_color,
           const AlphaGradient<float>& by_alpha, float by_depth, float force_scale) {
    const ExponentGradient<float> by_shape =
        fragment_exponent_vjp(splat.conic, fragment.dx, fragment.dy, by_alpha.exponent);
    SplatGradient& sum = gradients[fragment.position];
    sum.mean2d += by_shape.mean2d;
    sum.conic = {sum.conic.xx + by_shape.conic.xx, sum.conic.xy + by_shape.conic.xy,
                 sum.conic.yy + by_shape.conic.yy};
    sum.opacity += by_alpha.opacity;
    sum.color += by_color.color;
    sum.depth += by_depth;
    absolute[fragment.position] += Vec2f(std::abs(by_shape.mean2d.x), std::abs(by_shape.mean2d.y));
    const float force = force_scale * by_alpha.exponent;
    add_to(sums[fragment.position], {1.0f, force, force * force});
  }
};

template <BlendRule rule>
void blend_backward_tile(const RenderSettings& settings, const PictureGradient& dL,
                         const RenderPass& pass, const Tile& tile) {
  const TileFragments of_pixels = sorted_fragments(pass, tile);
  TileShares shares(tile.end - tile.begin);
  for (int pixel = 0; pixel < kTilePixels; ++pixel) {
    if (!tile.contains(pass, pixel)) continue;
    const std::size_t from = tile.image_index(pass, pixel);
    PixelBackwardState<float> state = backward_state(settings, dL, pass, from);
    const bool has_depth = !dL.depth.empty();
    DepthBackwardState<float> depth{has_depth ? pass.depth_image[from] : 0.0f,
                                    has_depth ? dL.depth[from] : 0.0f};
    const std::uint32_t blended = pass.last_instance[from];
    for (std::uint32_t n = 0; n < blended; ++n) {
      const Fragment& fragment = of_pixels[pixel][n];
      const Splat& splat = splat_of(pass, tile, fragment);
      const float alpha = fragment_alpha<rule>(splat.opacity, fragment.gaussian);
      const DepthCompositeGradient<float> by_depth =
          composite_depth_vjp(depth, state.transmittance, splat.depth, alpha, n + 1 == blended);
      const CompositeGradient<float> by_color =
          composite_vjp(state, splat.color, alpha, n + 1 == blended);
      const AlphaGradient<float> by_alpha = fragment_alpha_vjp<rule>(
          splat.opacity, fragment.gaussian, by_color.alpha + by_depth.alpha);
      shares.add(fragment, splat, by_color, by_alpha, by_depth.depth,
                 3.0f * float(pass.pixel_count()));
    }
  }
  const ScalarScratch& scratch = pass.scratch<ScalarScratch>();
  for (std::uint32_t k = tile.begin; k < tile.end; ++k) {
    const std::uint32_t instance = scratch.tile_instances[k], position = k - tile.begin;
    scratch.instance_gradients[instance] = shares.gradients[position];
    if (!scratch.absolute_gradients.empty())
      scratch.absolute_gradients[instance] = shares.absolute[position];
    if (!scratch.fragment_sums.empty()) scratch.fragment_sums[instance] = shares.sums[position];
  }
}

}  // namespace

void blend_by_pixel(const RenderSettings& settings, RenderPass& pass) {
  parallel_for(pass.tile_count(), 1, [&](std::size_t index) {
    const Tile tile(pass, index);
    if (settings.blend_rule == BlendRule::classic)
      blend_tile<BlendRule::classic>(settings, pass, tile);
    else
      blend_tile<BlendRule::faster_gs>(settings, pass, tile);
  });
}

void blend_backward_by_pixel(const RenderSettings& settings, const PictureGradient& dL,
                             RenderPass& pass) {
  parallel_for(pass.tile_count(), 1, [&](std::size_t index) {
    const Tile tile(pass, index);
    if (settings.blend_rule == BlendRule::classic)
      blend_backward_tile<BlendRule::classic>(settings, dL, pass, tile);
    else
      blend_backward_tile<BlendRule::faster_gs>(settings, dL, pass, tile);
  });
}

}  // namespace gs
