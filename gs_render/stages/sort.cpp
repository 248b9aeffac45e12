// SPDX-License-Identifier: Apache-2.0
// Stage 3: sorts instances by tile: a stable counting sort, whose counts become the tile ranges.
#include <numeric>

#include "gs_render/stage_clock.h"
#include "gs_render/stages.h"

namespace gs {

void sort_by_tile(RenderPass& pass) {
  const HostStage stage("tile sort");
  ScalarScratch& scratch = pass.scratch<ScalarScratch>();
  const std::size_t tiles = pass.tile_count(), instances = scratch.instance_tiles.size();
  pass.tile_ranges.resize_discard(tiles + 1);
  pass.tile_ranges.fill_zero();
  scratch.tile_instances.resize_discard(instances);
  pass.tile_splats.resize_discard(instances);

  for (const std::uint32_t tile : scratch.instance_tiles) ++pass.tile_ranges[tile + 1];
  std::partial_sum(pass.tile_ranges.begin(), pass.tile_ranges.end(), pass.tile_ranges.begin());

  // While instances are assigned, range t holds the next free place of tile t. In the end it is the
  // end of tile t, which is where tile t + 1 begins.
  for (std::size_t i = 0; i < instances; ++i) {
    const std::uint32_t place = pass.tile_ranges[scratch.instance_tiles[i]]++;
    scratch.tile_instances[place] = std::uint32_t(i);
    pass.tile_splats[place] = scratch.instance_splats[i];
  }
  std::copy_backward(pass.tile_ranges.begin(), pass.tile_ranges.end() - 1, pass.tile_ranges.end());
  pass.tile_ranges[0] = 0;
}

}  // namespace gs
