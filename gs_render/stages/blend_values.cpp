// SPDX-License-Identifier: Apache-2.0
// The score pass: goes through the tiles front to back once more, as blend_backward.cpp does, and
// sums values of the pixels over the fragments of each instance, each into a slot of its own.
#include "gs_core/math/render/blend.h"

#include "gs_core/error.h"
#include "gs_core/threads/parallel.h"
#include "gs_render/stage_clock.h"
#include "gs_render/stages.h"
#include "gs_render/stages/tile_loop.h"

namespace gs {
namespace {

struct TilePixels {
  float transmittance[kTilePixels], value[kTilePixels];
  std::uint32_t last[kTilePixels];
  std::uint32_t largest_last = 0;

  TilePixels(const RenderPass& pass, const Tile& tile, Span<const float> values) {
    for (int pixel = 0; pixel < kTilePixels; ++pixel) {
      transmittance[pixel] = 1.0f;
      value[pixel] = 0.0f;
      last[pixel] = 0;
      if (!tile.contains(pass, pixel)) continue;
      const std::size_t from = tile.image_index(pass, pixel);
      value[pixel] = values[from];
      last[pixel] = pass.last_instance[from];
      largest_last = std::max(largest_last, last[pixel]);
    }
  }
};

// FragmentSums per lane.
struct LaneSums {
  float count[kLanes] = {}, weighted[kLanes] = {}, value[kLanes] = {};

  FragmentSums total() const {
    return {sum_of_lanes(count), sum_of_lanes(weighted), sum_of_lanes(value)};
  }
};

template <BlendRule rule>
inline void blend_lanes(const Splat& splat, float dx, float dy, std::uint32_t position, int first,
                        TilePixels& pixels, LaneSums& sums) {
  const Splat s = splat;
  for (int lane = 0; lane < kLanes; ++lane) {
    const int i = first + lane;
    const float exponent = fragment_exponent(s.conic, dx + float(lane), dy);
    const float gaussian = exp_fragment(max_of(exponent, kMinExponent));
    const bool keep = (position < pixels.last[i]) & (exponent >= -s.cutoff);
    const float alpha = keep ? fragment_alpha<rule>(s.opacity, gaussian) : 0.0f;
    sums.count[lane] += float(keep);
    sums.weighted[lane] += pixels.transmittance[i] * alpha * pixels.value[i];
    sums.value[lane] += keep ? pixels.value[i] : 0.0f;
    pixels.transmittance[i] *= 1.0f - alpha;
  }
}

template <BlendRule rule>
void blend_tile(Span<const float> values, RenderPass& pass, std::size_t tile_index) {
  const Tile tile(pass, tile_index);
  ScalarScratch& scratch = pass.scratch<ScalarScratch>();
  TilePixels pixels(pass, tile, values);
  for (std::uint32_t k = tile.begin; k < tile.end; ++k) {
    LaneSums sums;
    const std::uint32_t gaussian = pass.tile_splats[k], position = k - tile.begin;
    const Splat& splat = pass.splats[gaussian];
    if (position < pixels.largest_last)
      for_each_lane_group(tile, pass.pixel_rects[gaussian], splat.mean2d,
                          [&](int first, float dx, float dy) {
                            blend_lanes<rule>(splat, dx, dy, position, first, pixels, sums);
                          });
    scratch.fragment_sums[scratch.tile_instances[k]] = sums.total();
  }
}

}  // namespace

void blend_values(const RenderSettings& settings, Span<const float> values, RenderPass& pass) {
  const HostStage stage("score pass");
  GS_CHECK(values.size == pass.pixel_count());
  ScalarScratch& scratch = pass.scratch<ScalarScratch>();
  scratch.fragment_sums.resize_discard(scratch.instance_splats.size());
  parallel_for(pass.tile_count(), 1, [&](std::size_t tile) {
    if (settings.blend_rule == BlendRule::classic)
      blend_tile<BlendRule::classic>(values, pass, tile);
    else
      blend_tile<BlendRule::faster_gs>(values, pass, tile);
  });
}

}  // namespace gs
