// SPDX-License-Identifier: Apache-2.0
// Stage 2: the visible Gaussians near to far, and one instance for each pair of a Gaussian and a
// tile that it hits.
#include <algorithm>
#include <limits>
#include <vector>

#include "gs_core/error.h"
#include "gs_core/math/render/depth_key.h"
#include "gs_core/threads/parallel.h"
#include "gs_core/threads/radix_sort.h"
#include "gs_render/stage_clock.h"
#include "gs_render/stages.h"

namespace gs {
namespace {

// Fills depth_order: indices of visible Gaussians, by depth, equal depths by index.
void order_by_depth(const RenderSettings& settings, RenderPass& pass) {
  const HostStage stage("depth sort");
  const std::size_t count = pass.tile_counts.size();
  pass.depth_order.resize_discard(count);
  std::size_t visible = 0;
  for (std::size_t i = 0; i < count; ++i)
    if (pass.tile_counts[i]) pass.depth_order[visible++] = std::uint32_t(i);
  pass.depth_order.resize(visible);
  const DepthKeys keys = depth_keys(settings.near_plane, settings.far_plane);
  radix_sort_by_key(pass.depth_order.span(), pass.scratch<ScalarScratch>().sort_scratch,
                    [&](std::uint32_t i) { return depth_key(keys, pass.splats[i].depth); });
}

/// Of each tile, whether it has a pixel of the mask above 0.
std::vector<std::uint8_t> drawn_tiles(const std::uint8_t* mask, const RenderPass& pass) {
  std::vector<std::uint8_t> is_drawn(pass.tile_count());
  parallel_for(is_drawn.size(), 64, [&](std::size_t tile) {
    const int left = int(tile % pass.tiles_x) * kTileWidth;
    const int top = int(tile / pass.tiles_x) * kTileHeight;
    for (int y = top; y < std::min(top + kTileHeight, pass.height); ++y)
      for (int x = left; x < std::min(left + kTileWidth, pass.width); ++x)
        is_drawn[tile] |= mask[std::size_t(y) * pass.width + x];
  });
  return is_drawn;
}

}  // namespace

void create_instances(const RenderSettings& settings, RenderPass& pass) {
  order_by_depth(settings, pass);
  const HostStage stage("instances");
  ScalarScratch& scratch = pass.scratch<ScalarScratch>();
  scratch.first_instance.resize_discard(pass.tile_counts.size());
  std::uint64_t total = 0;
  for (const std::uint32_t gaussian : pass.depth_order) {
    scratch.first_instance[gaussian] = std::uint32_t(total);
    total += pass.tile_counts[gaussian];
  }
  if (total > std::numeric_limits<std::uint32_t>::max())
    throw Error(
        "a view has more than 2^32 splats in tiles; lower the resolution (-r) or the number of "
        "Gaussians (--max-gaussians)",
        ExitCode::out_of_memory);
  scratch.instance_tiles.resize_discard(total);
  scratch.instance_splats.resize_discard(total);

  std::vector<std::uint8_t> is_drawn;
  if (settings.mask) is_drawn = drawn_tiles(settings.mask, pass);
  parallel_for(pass.depth_order.size(), 512, [&](std::size_t k) {
    const std::uint32_t gaussian = pass.depth_order[k];
    const Splat& splat = pass.splats[gaussian];
    std::uint32_t instance = scratch.first_instance[gaussian];
    for_each_hit_tile(splat.mean2d, splat.conic, tile_cutoff(settings.bounds, splat.cutoff),
                      pass.pixel_rects[gaussian], [&](int x, int y) {
                        const std::size_t tile = std::size_t(y) * pass.tiles_x + x;
                        scratch.instance_tiles[instance] = std::uint32_t(
                            is_drawn.empty() || is_drawn[tile] ? tile : pass.tile_count());
                        scratch.instance_splats[instance] = gaussian;
                        ++instance;
                      });
  });
}

}  // namespace gs
