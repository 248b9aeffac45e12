// SPDX-License-Identifier: Apache-2.0
// The variants of the kernel that blends on tensor cores, and the choice between them.
// blend_gemm.cu explains the method.
#pragma once

#include "cuda/render/blend/splat_queue.cuh"

namespace gs::cuda {

inline constexpr int kBlocks = 7;         // per multiprocessor, as many as registers allow
inline constexpr int kHistoryBlocks = 5;  // the same with history
// warps of 8 x 8 pixels, in multiples of those that run at a time
inline constexpr int kSmallPicture = 3;

/// A variant of the pixels that a warp blends.
template <BlendRule rule_, bool with_history_, bool with_depth_, int height_>
struct PixelVariant {
  static constexpr BlendRule rule = rule_;
  static constexpr bool with_history = with_history_;  // for the backward pass: last, checkpoints
  static constexpr bool with_depth = with_depth_;      // also sums the depths of splats
  static constexpr int height = height_;               // pixels of a sub-tile
  static constexpr bool has_part = height == kPart;
  using Queue = SplatQueue<with_history, with_depth, has_part ? kBatch : 2 * kBatch>;
  static constexpr int blocks = with_history ? kHistoryBlocks : kBlocks;
};

/// True where a picture has so few pixels that a warp takes 8 x 4 of them. Sub-tiles of 8 x 8 cost
/// less for each pixel, but only half as many warps share the work.
inline bool has_small_subtiles(const Context& context, std::size_t pixels) {
  return pixels / (kPart * kPart) <
         std::size_t(kSmallPicture * kBlocks * kBlendWarps * context.multiprocessors());
}

}  // namespace gs::cuda
