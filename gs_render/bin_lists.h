// SPDX-License-Identifier: Apache-2.0
// Lists of splats for bins of 32 or 64 pixels, with one bit for each entry and sub-tile of 8 x 8
// pixels: another form of the tiles' lists of stages 2 and 3. There are fewer entries than
// instances, each bin is sorted by itself, and a sub-tile reads only the bits of its own splats.
// This is the reference of cuda/render/bins.cu and bin_sort.cu; no scalar renderer reads these
// lists.
#pragma once

#include <vector>

#include "gs_core/math/bin_hits.h"
#include "gs_render/render_pass.h"

namespace gs {

inline constexpr int kEntriesOfWord = 32;

/// The lists of all bins of a view.
struct BinLists {
  int bin_side = 0;  // pixels
  int bins_x = 0, bins_y = 0;
  std::vector<std::uint32_t> ranges;  // (bins + 1)  bin b has entries ranges[b] .. ranges[b + 1]
  std::vector<std::uint32_t>
      rows;  // (E)  Gaussian of each entry; in a bin near to far, then by row
  std::vector<std::size_t> first_word;  // (bins + 1)  where a bin's words begin
  // For each bin and each of its sub-tiles a word for every 32 entries: bit k % 32 of word k / 32
  // is set where entry k of the bin hits the sub-tile.
  std::vector<std::uint32_t> words;

  int subtiles_per_row() const { return bin_side / kSubtileSide; }
  int subtiles() const { return subtiles_per_row() * subtiles_per_row(); }
  std::size_t bin_of(int subtile_x, int subtile_y) const {
    return std::size_t(subtile_y / subtiles_per_row()) * bins_x + subtile_x / subtiles_per_row();
  }

  /// Calls visit(row) for each splat that hits a sub-tile of the picture, near to far.
  template <class Visit>
  void for_each_splat(int subtile_x, int subtile_y, Visit&& visit) const {
    const std::size_t bin = bin_of(subtile_x, subtile_y);
    const std::uint32_t entries = ranges[bin + 1] - ranges[bin];
    const std::size_t count = (entries + kEntriesOfWord - 1) / kEntriesOfWord;
    const int subtile =
        subtile_y % subtiles_per_row() * subtiles_per_row() + subtile_x % subtiles_per_row();
    const std::uint32_t* const own = words.data() + first_word[bin] + std::size_t(subtile) * count;
    for (std::uint32_t k = 0; k < entries; ++k)
      if (own[k / kEntriesOfWord] >> k % kEntriesOfWord & 1) visit(rows[ranges[bin] + k]);
  }
};

/// The lists of a pass that preprocess() has filled. A sub-tile's splats, in order, do not depend
/// on the size of bins. Host memory only.
BinLists bin_lists(const RenderSettings& settings, const RenderPass& pass, int bin_side);

}  // namespace gs
