// SPDX-License-Identifier: Apache-2.0
// Stage 4: blends each tile's list of splats front to back. The loops go over splats, over the
// pixel rows of a splat, and over eight pixels at a time, so that compilers vectorize the innermost
// one.
#include "gs_core/math/render/blend.h"

#include "gs_core/threads/parallel.h"
#include "gs_render/stage_clock.h"
#include "gs_render/stages.h"
#include "gs_render/stages/pixel_order.h"
#include "gs_render/stages/tile_loop.h"

namespace gs {
namespace {

// The pixels of one tile while they are blended.
template <bool kDepth>
struct TilePixels {
  float red[kTilePixels], green[kTilePixels], blue[kTilePixels];
  float transmittance[kTilePixels];
  float depth[kDepth ? kTilePixels : 1];
  std::uint32_t is_open[kTilePixels];  // 1: takes further fragments, 0: does not
  std::uint32_t last[kTilePixels];     // 1 + position of the last blended splat

  TilePixels(const RenderPass& pass, const Tile& tile) {
    for (int pixel = 0; pixel < kTilePixels; ++pixel) {
      red[pixel] = green[pixel] = blue[pixel] = 0.0f;
      transmittance[pixel] = 1.0f;
      if constexpr (kDepth) depth[pixel] = 0.0f;
      is_open[pixel] = tile.contains(pass, pixel);
      last[pixel] = 0;
    }
  }
  bool all_closed() const {
    std::uint32_t open = 0;
    for (const std::uint32_t flag : is_open) open |= flag;
    return open == 0;
  }
};

// Blends one splat into kLanes neighboring pixels of a row.
template <BlendRule rule, bool kDepth>
inline void blend_lanes(const Splat& splat, float dx, float dy, std::uint32_t position, int first,
                        TilePixels<kDepth>& pixels) {
  const Splat s = splat;
  for (int lane = 0; lane < kLanes; ++lane) {
    const int i = first + lane;
    PixelState<float> state{{pixels.red[i], pixels.green[i], pixels.blue[i]},
                            pixels.transmittance[i]};
    const float exponent = fragment_exponent(s.conic, dx + float(lane), dy);
    const float gaussian = exp_fragment(max_of(exponent, kMinExponent));
    const float alpha = fragment_alpha<rule>(s.opacity, gaussian);
    std::uint32_t open = pixels.is_open[i];
    std::uint32_t keep = open & std::uint32_t(exponent >= -s.cutoff);
    if constexpr (rule == BlendRule::classic) {
      const std::uint32_t stops = keep & is_opaque(state.transmittance * (1.0f - alpha));
      open &= ~stops;
      keep &= ~stops;
    }
    if constexpr (kDepth) pixels.depth[i] += state.transmittance * (keep ? alpha : 0.0f) * s.depth;
    composite(state, s.color, keep ? alpha : 0.0f);
    if constexpr (rule == BlendRule::faster_gs) open &= !is_opaque(state.transmittance);
    pixels.red[i] = state.color.x;
    pixels.green[i] = state.color.y;
    pixels.blue[i] = state.color.z;
    pixels.transmittance[i] = state.transmittance;
    pixels.last[i] = keep ? position + 1 : pixels.last[i];
    pixels.is_open[i] = open;
  }
}

template <BlendRule rule, bool kDepth>
void blend_tile(const RenderSettings& settings, RenderPass& pass, std::size_t tile_index) {
  const Tile tile(pass, tile_index);
  TilePixels<kDepth> pixels(pass, tile);
  for (std::uint32_t k = tile.begin; k < tile.end; ++k) {
    if ((k - tile.begin) % kClosedCheckInterval == 0 && pixels.all_closed()) break;
    const std::uint32_t gaussian = pass.tile_splats[k];
    const Splat& splat = pass.splats[gaussian];
    for_each_lane_group(tile, pass.pixel_rects[gaussian], splat.mean2d,
                        [&](int first, float dx, float dy) {
                          blend_lanes<rule>(splat, dx, dy, k - tile.begin, first, pixels);
                        });
  }

  const std::size_t plane = pass.pixel_count();
  const Vec3f background = settings.background;
  for (int pixel = 0; pixel < kTilePixels; ++pixel) {
    if (!tile.contains(pass, pixel)) continue;
    const std::size_t to = tile.image_index(pass, pixel);
    const float T = pixels.transmittance[pixel];
    pass.image[to] = pixels.red[pixel] + T * background.x;
    pass.image[plane + to] = pixels.green[pixel] + T * background.y;
    pass.image[2 * plane + to] = pixels.blue[pixel] + T * background.z;
    pass.transmittance[to] = T;
    pass.last_instance[to] = pixels.last[pixel];
    if constexpr (kDepth) pass.depth_image[to] = pixels.depth[pixel];
  }
}

template <BlendRule rule>
void blend_tile_as_asked(const RenderSettings& settings, RenderPass& pass, std::size_t tile) {
  if (settings.blends_depth)
    blend_tile<rule, true>(settings, pass, tile);
  else
    blend_tile<rule, false>(settings, pass, tile);
}

}  // namespace

void blend(const RenderSettings& settings, RenderPass& pass) {
  const HostStage stage("blend");
  pass.image.resize_discard(3 * pass.pixel_count());
  pass.transmittance.resize_discard(pass.pixel_count());
  pass.last_instance.resize_discard(pass.pixel_count());
  pass.depth_image.resize_discard(settings.blends_depth ? pass.pixel_count() : 0);
  if (!pass.ray_depths.empty()) return blend_by_pixel(settings, pass);
  parallel_for(pass.tile_count(), 1, [&](std::size_t tile) {
    if (settings.blend_rule == BlendRule::classic)
      blend_tile_as_asked<BlendRule::classic>(settings, pass, tile);
    else
      blend_tile_as_asked<BlendRule::faster_gs>(settings, pass, tile);
  });
}

}  // namespace gs
