// SPDX-License-Identifier: Apache-2.0
// The variants of the kernel that blends on tensor cores, and the choice between them.
// blend_gemm.cu explains the method.
#pragma once

#include "cuda/render/splat_queue.cuh"

namespace gs::cuda {

inline constexpr int kBlocks = 7;         // per multiprocessor, as many as registers allow
inline constexpr int kHistoryBlocks = 5;  // the same with history
// warps of 8 x 8 pixels, in multiples of those that run at a time
inline constexpr int kSmallPicture = 3;

/// A variant of the pixels that a warp blends.
///
/// In a fast one weights go into the product of colors cut off to TF32, as the tensor cores read
/// them. The pixel's color is divided by the sum of these weights and multiplied by that of the
/// uncut ones, which is 1 - transmittance: what remains of the cuts is their scatter, times
/// differences of color within the pixel.
template <BlendRule rule_, bool with_history_, bool fast_, int height_>
struct PixelVariant {
  static_assert(!fast_ || (!with_history_ && rule_ == BlendRule::faster_gs));
  static constexpr BlendRule rule = rule_;
  static constexpr bool with_history = with_history_;  // for the backward pass: last, checkpoints
  static constexpr bool fast = fast_;                  // for viewing
  static constexpr int height = height_;               // pixels of a sub-tile
  static constexpr bool has_part = height == kPart;
  using Queue = SplatQueue<with_history, has_part ? kBatch : 2 * kBatch, fast>;
  static constexpr int blocks = with_history ? kHistoryBlocks : kBlocks;
};

/// True where a picture has so few pixels that a warp takes 8 x 4 of them. Sub-tiles of 8 x 8 cost
/// less for each pixel, but only half as many warps share the work.
inline bool has_small_subtiles(const Context& context, std::size_t pixels) {
  return pixels / (kPart * kPart) <
         std::size_t(kSmallPicture * kBlocks * kBlendWarps * context.multiprocessors());
}

/// Calls f(std::bool_constant<value>()).
template <class F>
void with_constant(bool value, F&& f) {
  if (value)
    f(std::true_type());
  else
    f(std::false_type());
}
/// For a picture without a backward pass: calls f with the blend rule, and with whether blending is
/// fast. It is exact under the classic rule, where a pixel's end may be worth 1 % of its light.
template <class F>
void with_rule_and_speed(const RenderSettings& settings, F&& f) {
  with_rule(settings.blend_rule, [&](auto rule) {
    if constexpr (rule() == BlendRule::classic)
      f(rule, std::false_type());
    else
      with_constant(settings.fast_blending, [&](auto fast) { f(rule, fast); });
  });
}

}  // namespace gs::cuda
