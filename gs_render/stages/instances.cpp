// SPDX-License-Identifier: Apache-2.0
// Stage 2: the visible Gaussians near to far, and one instance for each pair of a Gaussian and a
// tile that it hits.
#include <limits>

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

  parallel_for(pass.depth_order.size(), 512, [&](std::size_t k) {
    const std::uint32_t gaussian = pass.depth_order[k];
    const Splat& splat = pass.splats[gaussian];
    std::uint32_t instance = scratch.first_instance[gaussian];
    for_each_hit_tile(splat.mean2d, splat.conic, tile_cutoff(settings.bounds, splat.cutoff),
                      pass.pixel_rects[gaussian], [&](int x, int y) {
                        scratch.instance_tiles[instance] = std::uint32_t(y * pass.tiles_x + x);
                        scratch.instance_splats[instance] = gaussian;
                        ++instance;
                      });
  });
}

}  // namespace gs
