// SPDX-License-Identifier: Apache-2.0
// How a warp walks a bin's list: it reads the words of its sub-tile, 32 at a time for 1,024
// entries, and fetches only the splats of bits that are set. Three things overlap: while one batch
// of splats is blended, the next one is copied into shared memory, and the rows of the one after
// are loaded.
#pragma once

#include "cuda/render/bins.cuh"
#include "cuda/render/subtile.cuh"

namespace gs::cuda {

/// A picture and its lists by bins.
struct BinPicture {
  int width, height, bins_x;
  int subtiles_per_row;  // of a bin
  const std::uint32_t *ranges, *first_groups, *rows, *words;
  const ViewSplat* splats;
};

/// One warp's walk through the hits of a sub-tile of 8 x 8 pixels. Without `has_quarter` the warp
/// owns half of it, and splats are tested against its pixels.
template <bool has_quarter>
class BinWalk {
 public:
  /// Shared memory, one for each warp.
  struct Ahead {
    SplatOfLanes<ViewSplat> splats;  // of the next batch
    std::uint32_t entries[kWarp];    // places of the batch after it
  };

  /// `subtile` is its number within the bin.
  __device__ BinWalk(Ahead& ahead, const BinPicture& lists, std::uint32_t bin, int subtile,
                     const PixelRange& pixels)
      : ahead_(ahead), lists_(lists), place_(lists.ranges[bin]), pixels_(pixels) {
    const std::uint32_t first_group = lists.first_groups[bin];
    word_count_ = lists.first_groups[bin + 1] - first_group;
    const std::size_t per_group =
        std::size_t(lists.subtiles_per_row) * std::size_t(lists.subtiles_per_row);
    words_ = lists.words + per_group * first_group + std::size_t(subtile) * word_count_;
    bits_ = word_at(lane_of_thread());
    bits_ahead_ = word_at(kWarp + lane_of_thread());
    find();
    start_copy();
    find();
  }
  __device__ bool is_done() const { return copied_ == 0; }

  /// The whole warp: takes up to 32 splats of the list that hit the pixels, and returns their
  /// number. Calls take(k, splat, 0, 0) for the k-th of them, each in a lane of its own.
  template <class Take>
  __device__ int take_next(const Take& take) {
    __pipeline_wait_prior(0);
    const ViewSplat splat = ahead_.splats.load();
    bool hit = lane_of_thread() < copied_;
    __syncwarp();
    start_copy();
    find();
    if constexpr (!has_quarter) {
      const SplatOutline outline = outline_of(splat);
      // Both are evaluated: a branch would cost more.
      hit = hit & rectangle_is_hit(outline.mean2d, outline.conic, outline.cutoff, pixels_.x_min,
                                   pixels_.x_max, pixels_.y_min, pixels_.y_max, kSubtileSlack);
    }
    const unsigned hits = __ballot_sync(kAllLanes, hit);
    if (hit) take(__popc(hits & lanes_below()), splat, 0u, 0u);
    __syncwarp();
    return __popc(hits);
  }

 private:
  __device__ std::uint32_t word_at(std::uint32_t k) const {
    return k < word_count_ ? words_[k] : 0;
  }

  // Starts to copy the splats whose rows were loaded.
  __device__ void start_copy() {
    copied_ = found_;
    if (lane_of_thread() < copied_) ahead_.splats.start_copy(lists_.splats[row_]);
    __pipeline_commit();
  }

  // Finds the next 32 hits, or those that are left, and starts to load their rows.
  __device__ void find() {
    const std::uint32_t lane = lane_of_thread();
    found_ = 0;
    while (found_ < kWarp) {
      const std::uint32_t own = __popc(bits_), first = found_ + warp_exclusive_sum(own);
      const std::uint32_t end = __shfl_sync(kAllLanes, first + own, kWarp - 1);
      for (std::uint32_t k = first; bits_ != 0 && k < kWarp; ++k, bits_ &= bits_ - 1)
        ahead_.entries[k] = place_ + lane * kEntriesOfWord + __ffs(int(bits_)) - 1;
      found_ = min(end, std::uint32_t(kWarp));
      if (end >= kWarp) break;
      if (word_count_ <= kWarp) break;  // all bits were taken
      place_ += kWarp * kEntriesOfWord;
      words_ += kWarp;
      word_count_ -= kWarp;
      bits_ = bits_ahead_;
      bits_ahead_ = word_at(kWarp + lane);
    }
    __syncwarp();
    if (lane < found_) row_ = lists_.rows[ahead_.entries[lane]];
  }

  Ahead& ahead_;
  const BinPicture& lists_;
  const std::uint32_t* words_;       // of the sub-tile, from the one that lane 0 has
  std::uint32_t word_count_;         // from there on
  std::uint32_t place_;              // of that word's first entry
  std::uint32_t bits_, bits_ahead_;  // this lane's: hits that are left, and its next word
  const PixelRange pixels_;
  std::uint32_t row_ = 0;                 // this lane's splat of the batch after the next
  std::uint32_t copied_ = 0, found_ = 0;  // splats of the next batch, and of the one after
};

}  // namespace gs::cuda
