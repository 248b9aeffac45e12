// SPDX-License-Identifier: Apache-2.0
// What frames of a packed model leave with their RenderPass on the GPU. Host code can read it, as
// tests do.
#pragma once

#include "gs_core/math/view_splat.h"
#include "gs_render/render_pass.h"

namespace gs::cuda {

// clang-format off
/// Lists by bins in device memory, in the form of BinLists (gs_render/bin_lists.h), which is their
/// reference.
struct BinBuffers {
  int side = 0;                         // pixels: 32 or 64
  int bins_x = 0, bins_y = 0;
  Buffer<std::uint32_t> ranges;         // (bins + 1)  bin b has entries ranges[b] .. ranges[b + 1]
  Buffer<std::uint32_t> first_groups;   // (bins + 1)  groups of up to 32 entries in the bins before
  Buffer<std::uint32_t> order;          // (bins)      those with the longest lists first
  Buffer<std::uint32_t> rows;           // (capacity)  Gaussian of each entry; in a bin near to far, then by row
  Buffer<std::uint32_t> words;          // (most groups, sub-tiles)  a bin has one word for each sub-tile and group

  explicit BinBuffers(Memory& memory)
      : ranges(memory), first_groups(memory), order(memory), rows(memory), words(memory) {}
  std::size_t count() const { return std::size_t(bins_x) * bins_y; }
};

/// The scratch of frames of a packed model.
struct ViewScratch : BackendScratch {
  bool has_view_splats = false;         // stage 1 has filled view_splats in place of pass.splats
  Buffer<ViewSplat> view_splats;        // (N)
  BinBuffers bins;                      // RenderSettings::bin_side

  explicit ViewScratch(Memory& memory) : view_splats(memory), bins(memory) {}
};
// clang-format on

}  // namespace gs::cuda
