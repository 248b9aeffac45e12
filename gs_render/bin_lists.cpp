// SPDX-License-Identifier: Apache-2.0
#include "gs_render/bin_lists.h"

#include <algorithm>
#include <numeric>

#include "gs_core/math/depth_key.h"

namespace gs {
namespace {

// Calls visit(bin) for each bin that lists a row.
template <class Visit>
void for_each_bin(const RenderSettings& settings, const RenderPass& pass, const BinLists& lists,
                  std::size_t row, Visit&& visit) {
  if (!pass.tile_counts[row]) return;
  const Rect& pixels = pass.pixel_rects[row];
  const int side = lists.bin_side;
  for (int y = pixels.y_begin / side; y * side < pixels.y_end; ++y) {
    const BinSpan span =
        hit_bins_of_row(settings.bounds, outline_of(pass.splats[row]), pixels, y, side);
    for (int x = span.begin; x < span.end; ++x) visit(std::size_t(y) * lists.bins_x + x);
  }
}

std::vector<std::uint32_t> entries_of_bins(const RenderSettings& settings, const RenderPass& pass,
                                           const BinLists& lists) {
  std::vector<std::uint32_t> ends(std::size_t(lists.bins_x) * lists.bins_y + 1);
  for (std::size_t row = 0; row < pass.tile_counts.size(); ++row)
    for_each_bin(settings, pass, lists, row, [&](std::size_t bin) { ++ends[bin + 1]; });
  std::partial_sum(ends.begin(), ends.end(), ends.begin());
  return ends;
}

// Writes the words of one bin, whose rows are in order.
void write_words(const RenderSettings& settings, const RenderPass& pass, std::size_t bin,
                 BinLists& lists) {
  const std::uint32_t begin = lists.ranges[bin], entries = lists.ranges[bin + 1] - begin;
  const std::size_t count = (entries + kEntriesOfWord - 1) / kEntriesOfWord;
  for (std::uint32_t k = 0; k < entries; ++k) {
    const std::uint32_t row = lists.rows[begin + k];
    const SubtileBits bits =
        subtile_bits(settings.bounds, outline_of(pass.splats[row]), pass.pixel_rects[row],
                     int(bin) % lists.bins_x, int(bin) / lists.bins_x, lists.bin_side);
    for (int subtile = 0; subtile < lists.subtiles(); ++subtile)
      if (bits >> subtile & 1)
        lists.words[lists.first_word[bin] + std::size_t(subtile) * count + k / kEntriesOfWord] |=
            1u << k % kEntriesOfWord;
  }
}

}  // namespace

BinLists bin_lists(const RenderSettings& settings, const RenderPass& pass, int bin_side) {
  GS_CHECK(bin_side == 32 || bin_side == 64);
  BinLists lists;
  lists.bin_side = bin_side;
  lists.bins_x = (pass.width + bin_side - 1) / bin_side;
  lists.bins_y = (pass.height + bin_side - 1) / bin_side;
  lists.ranges = entries_of_bins(settings, pass, lists);

  const DepthKeys keys = depth_keys(settings.near_plane, settings.far_plane);
  std::vector<std::uint32_t> next(lists.ranges.begin(), lists.ranges.end() - 1);
  lists.rows.resize(lists.ranges.back());
  for (std::size_t row = 0; row < pass.tile_counts.size(); ++row)
    for_each_bin(settings, pass, lists, row,
                 [&](std::size_t bin) { lists.rows[next[bin]++] = std::uint32_t(row); });

  lists.first_word.assign(lists.ranges.size(), 0);
  for (std::size_t bin = 0; bin + 1 < lists.ranges.size(); ++bin) {
    const std::uint32_t begin = lists.ranges[bin], end = lists.ranges[bin + 1];
    std::sort(lists.rows.begin() + begin, lists.rows.begin() + end,
              [&](std::uint32_t a, std::uint32_t b) {
                return std::pair(depth_key(keys, pass.depths[a]), a) <
                       std::pair(depth_key(keys, pass.depths[b]), b);
              });
    const std::size_t words = (end - begin + kEntriesOfWord - 1) / kEntriesOfWord;
    lists.first_word[bin + 1] = lists.first_word[bin] + std::size_t(lists.subtiles()) * words;
  }
  lists.words.assign(lists.first_word.back(), 0);
  for (std::size_t bin = 0; bin + 1 < lists.ranges.size(); ++bin)
    write_words(settings, pass, bin, lists);
  return lists;
}

}  // namespace gs
