// SPDX-License-Identifier: Apache-2.0
// Stage 6: gradients of blending, per Gaussian and front to back. Each instance sums the gradients
// of its fragments over the tile's pixels and writes them to a slot of its own. No two threads add
// to the same number, and the sum of a splat has a fixed order.
#include "gs_core/math/render/blend.h"

#include <cmath>

#include "gs_core/threads/parallel.h"
#include "gs_render/stage_clock.h"
#include "gs_render/stages.h"
#include "gs_render/stages/pixel_order.h"
#include "gs_render/stages/tile_loop.h"

namespace gs {
namespace {

// The pixels of one tile in the backward pass: PixelBackwardState, one array per member.
template <bool kDepth>
struct TilePixels {
  float red[kTilePixels], green[kTilePixels], blue[kTilePixels];  // color behind
  static constexpr int kDepthPixels = kDepth ? kTilePixels : 1;
  float depth[kDepthPixels], d_depth[kDepthPixels];  // depth behind, dL/d(depth)
  float transmittance[kTilePixels];
  float d_red[kTilePixels], d_green[kTilePixels], d_blue[kTilePixels];  // dL/d(pixel)
  float d_final[kTilePixels];
  std::uint32_t last[kTilePixels];
  std::uint32_t largest_last = 0;

  TilePixels(const RenderPass& pass, const Tile& tile, const Vec3f& background,
             const PictureGradient& dL) {
    const std::size_t plane = pass.pixel_count();
    for (int pixel = 0; pixel < kTilePixels; ++pixel) {
      red[pixel] = green[pixel] = blue[pixel] = 0.0f;
      d_red[pixel] = d_green[pixel] = d_blue[pixel] = d_final[pixel] = 0.0f;
      if constexpr (kDepth) depth[pixel] = d_depth[pixel] = 0.0f;
      transmittance[pixel] = 1.0f;
      last[pixel] = 0;
      if (!tile.contains(pass, pixel)) continue;
      const std::size_t from = tile.image_index(pass, pixel);
      const float T = pass.transmittance[from];
      red[pixel] = pass.image[from] - T * background.x;
      green[pixel] = pass.image[plane + from] - T * background.y;
      blue[pixel] = pass.image[2 * plane + from] - T * background.z;
      d_red[pixel] = dL.image[from];
      d_green[pixel] = dL.image[plane + from];
      d_blue[pixel] = dL.image[2 * plane + from];
      d_final[pixel] = -T * inner(Vec3f(d_red[pixel], d_green[pixel], d_blue[pixel]), background);
      if (!dL.alpha.empty()) d_final[pixel] += T * dL.alpha[from];
      if constexpr (kDepth) {
        depth[pixel] = pass.depth_image[from];
        d_depth[pixel] = dL.depth[from];
      }
      last[pixel] = pass.last_instance[from];
      largest_last = std::max(largest_last, last[pixel]);
    }
  }
};

// A SplatGradient per lane. The lanes are summed once, at the end, in a fixed order.
template <bool kAbsolute, FragmentStatistic kStatistic, bool kDepth>
struct LaneSums {
  float mean_x[kLanes] = {}, mean_y[kLanes] = {};
  float conic_xx[kLanes] = {}, conic_xy[kLanes] = {}, conic_yy[kLanes] = {};
  float opacity[kLanes] = {};
  float red[kLanes] = {}, green[kLanes] = {}, blue[kLanes] = {};
  static constexpr int kAbsoluteLanes = kAbsolute ? kLanes : 1;
  float absolute_x[kAbsoluteLanes] = {}, absolute_y[kAbsoluteLanes] = {};
  float depth[kDepth ? kLanes : 1] = {};
  static constexpr int kStatisticLanes = kStatistic == FragmentStatistic::none ? 1 : kLanes;
  float count[kStatisticLanes] = {}, first[kStatisticLanes] = {};
  float second[kStatisticLanes] = {};

  SplatGradient total() const {
    SplatGradient sum{{sum_of_lanes(mean_x), sum_of_lanes(mean_y)},
                      {sum_of_lanes(conic_xx), sum_of_lanes(conic_xy), sum_of_lanes(conic_yy)},
                      sum_of_lanes(opacity),
                      {sum_of_lanes(red), sum_of_lanes(green), sum_of_lanes(blue)}};
    if constexpr (kDepth) sum.depth = sum_of_lanes(depth);
    return sum;
  }
  Vec2f absolute_total() const { return {sum_of_lanes(absolute_x), sum_of_lanes(absolute_y)}; }
  // `scale` is that of the forces, from the gradients of the mean loss to those of its sum.
  FragmentSums fragment_total(float scale) const {
    return {sum_of_lanes(count), scale * sum_of_lanes(first), scale * scale * sum_of_lanes(second)};
  }
};

template <BlendRule rule, bool kAbsolute, FragmentStatistic kStatistic, bool kDepth>
inline void blend_backward_lanes(const Splat& splat, float dx, float dy, std::uint32_t position,
                                 int first, TilePixels<kDepth>& pixels,
                                 LaneSums<kAbsolute, kStatistic, kDepth>& sums) {
  const Splat s = splat;
  for (int lane = 0; lane < kLanes; ++lane) {
    const int i = first + lane;
    const float exponent = fragment_exponent(s.conic, dx + float(lane), dy);
    const float gaussian = exp_fragment(max_of(exponent, kMinExponent));
    const bool keep = (position < pixels.last[i]) & (exponent >= -s.cutoff);
    const float alpha = keep ? fragment_alpha<rule>(s.opacity, gaussian) : 0.0f;

    if constexpr (kStatistic != FragmentStatistic::none) sums.count[lane] += float(keep);
    PixelBackwardState<float> state{{pixels.red[i], pixels.green[i], pixels.blue[i]},
                                    pixels.transmittance[i],
                                    {pixels.d_red[i], pixels.d_green[i], pixels.d_blue[i]},
                                    pixels.d_final[i]};
    float dL_dalpha = 0;
    if constexpr (kDepth) {
      DepthBackwardState<float> depth{pixels.depth[i], pixels.d_depth[i]};
      const DepthCompositeGradient<float> by_depth = composite_depth_vjp(
          depth, state.transmittance, s.depth, alpha, position + 1 == pixels.last[i]);
      pixels.depth[i] = depth.behind;
      sums.depth[lane] += by_depth.depth;
      dL_dalpha = by_depth.alpha;
    }
    const CompositeGradient<float> dL =
        composite_vjp(state, s.color, alpha, position + 1 == pixels.last[i]);
    pixels.red[i] = state.color_behind.x;
    pixels.green[i] = state.color_behind.y;
    pixels.blue[i] = state.color_behind.z;
    pixels.transmittance[i] = state.transmittance;

    const AlphaGradient<float> dL_fragment =
        fragment_alpha_vjp<rule>(s.opacity, gaussian, keep ? dL.alpha + dL_dalpha : 0.0f);
    const ExponentGradient<float> dL_splat =
        fragment_exponent_vjp(s.conic, dx + float(lane), dy, dL_fragment.exponent);
    if constexpr (kStatistic == FragmentStatistic::force) {
      sums.first[lane] += dL_fragment.exponent;
      sums.second[lane] += dL_fragment.exponent * dL_fragment.exponent;
    }
    sums.mean_x[lane] += dL_splat.mean2d.x;
    sums.mean_y[lane] += dL_splat.mean2d.y;
    if constexpr (kAbsolute) {
      sums.absolute_x[lane] += std::abs(dL_splat.mean2d.x);
      sums.absolute_y[lane] += std::abs(dL_splat.mean2d.y);
    }
    sums.conic_xx[lane] += dL_splat.conic.xx;
    sums.conic_xy[lane] += dL_splat.conic.xy;
    sums.conic_yy[lane] += dL_splat.conic.yy;
    sums.opacity[lane] += dL_fragment.opacity;
    sums.red[lane] += dL.color.x;
    sums.green[lane] += dL.color.y;
    sums.blue[lane] += dL.color.z;
  }
}

template <BlendRule rule, bool kAbsolute, FragmentStatistic kStatistic, bool kDepth>
void blend_backward_tile(const RenderSettings& settings, const PictureGradient& dL,
                         const RenderPass& pass, std::size_t tile_index) {
  const Tile tile(pass, tile_index);
  const ScalarScratch& scratch = pass.scratch<ScalarScratch>();
  TilePixels<kDepth> pixels(pass, tile, settings.background, dL);
  const float scale = 3.0f * float(pass.pixel_count());
  for (std::uint32_t k = tile.begin; k < tile.end; ++k) {
    LaneSums<kAbsolute, kStatistic, kDepth> sums;
    const std::uint32_t instance = scratch.tile_instances[k], position = k - tile.begin;
    if (position < pixels.largest_last) {
      const std::uint32_t gaussian = pass.tile_splats[k];
      const Splat& splat = pass.splats[gaussian];
      for_each_lane_group(
          tile, pass.pixel_rects[gaussian], splat.mean2d, [&](int first, float dx, float dy) {
            blend_backward_lanes<rule>(splat, dx, dy, position, first, pixels, sums);
          });
    }
    scratch.instance_gradients[instance] = sums.total();
    if constexpr (kAbsolute) scratch.absolute_gradients[instance] = sums.absolute_total();
    if constexpr (kStatistic != FragmentStatistic::none)
      scratch.fragment_sums[instance] = sums.fragment_total(scale);
  }
}

using BlendTiles = void(const RenderSettings& settings, const PictureGradient& dL,
                        RenderPass& pass);

template <BlendRule rule, bool kAbsolute, FragmentStatistic kStatistic>
void blend_backward_tiles(const RenderSettings& settings, const PictureGradient& dL,
                          RenderPass& pass) {
  const auto each_tile = [&](auto* blend_tile) {
    parallel_for(pass.tile_count(), 1,
                 [&](std::size_t tile) { blend_tile(settings, dL, pass, tile); });
  };
  if (dL.depth.empty())
    each_tile(blend_backward_tile<rule, kAbsolute, kStatistic, false>);
  else
    each_tile(blend_backward_tile<rule, kAbsolute, kStatistic, true>);
}

template <FragmentStatistic kStatistic>
BlendTiles* tiles_for(const RenderSettings& settings) {
  const bool is_classic = settings.blend_rule == BlendRule::classic;
  if (settings.absolute_gradient)
    return is_classic ? blend_backward_tiles<BlendRule::classic, true, kStatistic>
                      : blend_backward_tiles<BlendRule::faster_gs, true, kStatistic>;
  return is_classic ? blend_backward_tiles<BlendRule::classic, false, kStatistic>
                    : blend_backward_tiles<BlendRule::faster_gs, false, kStatistic>;
}

BlendTiles* tiles_for_statistic(const RenderSettings& settings) {
  switch (settings.fragment_statistic) {
    case FragmentStatistic::none: break;
    case FragmentStatistic::force: return tiles_for<FragmentStatistic::force>(settings);
  }
  return tiles_for<FragmentStatistic::none>(settings);
}

}  // namespace

void blend_backward(const RenderSettings& settings, const PictureGradient& dL, RenderPass& pass) {
  const HostStage stage("blend backward");
  ScalarScratch& scratch = pass.scratch<ScalarScratch>();
  const std::size_t instances = scratch.instance_splats.size();
  const bool has_sums = settings.fragment_statistic != FragmentStatistic::none;
  scratch.instance_gradients.resize_discard(instances);
  scratch.absolute_gradients.resize_discard(settings.absolute_gradient ? instances : 0);
  scratch.fragment_sums.resize_discard(has_sums ? instances : 0);
  if (pass.tile_splats.size() < instances) {  // those of masked tiles
    scratch.instance_gradients.fill_zero();
    scratch.absolute_gradients.fill_zero();
    scratch.fragment_sums.fill_zero();
  }
  if (!pass.ray_depths.empty()) return blend_backward_by_pixel(settings, dL, pass);
  tiles_for_statistic(settings)(settings, dL, pass);
}

}  // namespace gs
