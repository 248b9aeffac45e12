// SPDX-License-Identifier: Apache-2.0
// Stage 3: sorts instances by tile: a stable counting sort, whose counts become the tile ranges.
#include <numeric>

#include "gs_render/stage_clock.h"
#include "gs_render/stages.h"

namespace gs {

void sort_by_tile(RenderPass& pass) {
  const HostStage stage("tile sort");
  ScalarScratch& scratch = pass.scratch<ScalarScratch>();
  const std::size_t tiles = pass.tile_count();
  pass.tile_ranges.resize_discard(tiles + 1);
  pass.tile_ranges.fill_zero();
  for (const std::uint32_t tile : scratch.instance_tiles)
    if (tile < tiles) ++pass.tile_ranges[tile + 1];
  std::partial_sum(pass.tile_ranges.begin(), pass.tile_ranges.end(), pass.tile_ranges.begin());
  scratch.tile_instances.resize_discard(pass.tile_ranges[tiles]);
  pass.tile_splats.resize_discard(pass.tile_ranges[tiles]);

  // While instances are assigned, range t holds the next free place of tile t. In the end it is the
  // end of tile t, which is where tile t + 1 begins.
  for (std::size_t i = 0; i < scratch.instance_tiles.size(); ++i) {
    if (scratch.instance_tiles[i] == tiles) continue;
    const std::uint32_t place = pass.tile_ranges[scratch.instance_tiles[i]]++;
    scratch.tile_instances[place] = std::uint32_t(i);
    pass.tile_splats[place] = scratch.instance_splats[i];
  }
  std::copy_backward(pass.tile_ranges.begin(), pass.tile_ranges.end() - 1, pass.tile_ranges.end());
  pass.tile_ranges[0] = 0;
}

}  // namespace gs
