// SPDX-License-Identifier: Apache-2.0
// Lists by bins, as their three files share them: bins.cu fills them, bin_sort.cu sorts them, and
// blend_bins.cu blends them.
#pragma once

#include "cuda/stages.cuh"
#include "gs_render/bin_lists.h"

namespace gs::cuda {

/// An entry before it is sorted: the depth key above the row. Entries of a bin differ from each
/// other, so that their order does not depend on how they were written.
GS_HD BinEntry bin_entry(std::uint32_t depth_key, std::uint32_t row) {
  return BinEntry(depth_key) << 32 | row;
}
GS_HD std::uint32_t depth_key_of(BinEntry entry) { return std::uint32_t(entry >> 32); }
GS_HD std::uint32_t row_of(BinEntry entry) { return std::uint32_t(entry); }

/// Groups of up to 32 entries; each sub-tile has a word for a group.
GS_HD std::uint32_t groups_of(std::uint32_t entries) {
  return entries / kEntriesOfWord + (entries % kEntriesOfWord > 0);
}

/// Calls f with the side of bins as a constant.
template <class F>
void with_bin_side(int side, F&& f) {
  GS_CHECK(side == 32 || side == 64);
  if (side == 32)
    f(std::integral_constant<int, 32>());
  else
    f(std::integral_constant<int, 64>());
}

}  // namespace gs::cuda
