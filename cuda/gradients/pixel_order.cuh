// SPDX-License-Identifier: Apache-2.0
// Stage 6 of the order by pixel: the walk of the forward pass again, front to back, with the same
// decisions (render/blend/pixel_order.cuh). In place of the alpha of a fragment its f and w are left
// when it is blended. Once no pixel waits with a quarter of the places, the products of
// splat_shares.cuh sum these as in the order by z.
#pragma once

#include "cuda/gradients/splat_shares.cuh"
#include "cuda/render/blend/pixel_order.cuh"

namespace gs::cuda {

template <BlendRule rule, class Sums>
__global__ void __launch_bounds__(kPixelOrderThreads)
    blend_backward_by_pixel_kernel(TileLists lists, const RayDepth<float>* rays,
                                   const std::uint32_t* tile_order, Background background,
                                   Forward forward, PictureGradientPointers dL, Sums sums) {
  constexpr bool kHasFragments = Sums::kStatistic != FragmentStatistic::none;
  constexpr int kProductFloats = sizeof(ProductFragments) / sizeof(float);
  using Walk = PixelOrderWalk<Sums::kDepth>;
  __shared__ typename Walk::Shared shared;
  __shared__ ProductFragments fragments[kPlaces / kProductSplats];
  __shared__ ProductColors<Sums::kDepth> colors;
  const int lane = lane_of_thread();
  const Subtile subtile(lists, tile_of(tile_order, blockIdx.x / kSubtilesPerTile),
                        int(blockIdx.x % kSubtilesPerTile));
  PixelWalk<Sums::kDepth> pixel(lists, subtile, background(), forward, dL);
  if (!__any_sync(kAllLanes, pixel.last >= 0)) return;  // `last` counts the fragments here
  write_colors(colors, pixel);
  const Monomials monomials;
  const Vec2f center{float(subtile.x0) + 0.5f * kSubtileWidth,
                     float(subtile.y0) + 0.5f * kSubtileHeight};
  float* const left = fragments[0].of + place_of_f(lane / 8) + 2 * (lane % 8);
  const auto f_of = [&](int place) {  // w lies place_of_w(0) behind it
    const int k = place % kProductSplats;
    return left + place / kProductSplats * kProductFloats + k / 2 * kPairStride + k % 2;
  };
  static_assert(kWindow == kProductSplats);
  const auto add_quarter = [&](Walk& walk, int quarter) {
    const int count = walk.listed_in(quarter);
    if (count == 0) return;
    const typename Walk::Listed* const list = shared.listed + quarter * kWindow;
    SplatOfLane of_lane;
    for (int i = 0; (Sums::kAbsolute || kHasFragments) && i < count; ++i) {
      const float* const f = f_of(quarter * kWindow + i);
      const unsigned kept = __ballot_sync(kAllLanes, f[place_of_w(0)] != 0.0f);
      const Vec2f absolute = absolute_gradient(list[i], float(subtile.x) + 0.5f - list[i].mean2d.x,
                                               float(subtile.y) + 0.5f - list[i].mean2d.y, *f);
      if (lane == i) of_lane = {absolute, kept};
    }
    add_shares(fragments[quarter], colors, list, count, of_lane, monomials, center, sums);
  };
  int blended = 0;
  Walk walk(shared, lists, rays, subtile);
  do {
    add_quarter(walk, walk.next_quarter());
    walk.take(
        blended <= pixel.last,
        [&](int place, const typename Walk::Listed& splat, float e, bool is_kept) {
          float* const f = f_of(place);
          *f = is_kept ? fragment_alpha<rule>(splat.opacity, exp2_fragment(e)) : 0.0f;
          f[place_of_w(0)] = 0.0f;
        },
        [&](int place, const typename Walk::Listed& splat) {
          float* const f = f_of(place);
          float2 fragment{0, 0};
          if (blended <= pixel.last) {
            const float alpha = *f;
            fragment =
                pixel.advance(splat, alpha, rule == BlendRule::classic && alpha >= kMaxAlphaClassic,
                              blended == pixel.last);
            ++blended;
          }
          *f = fragment.x;
          f[place_of_w(0)] = fragment.y;
        });
  } while (!walk.is_done());
  for (int quarter = 0; quarter < kQuarters; ++quarter) add_quarter(walk, quarter);
}

}  // namespace gs::cuda
