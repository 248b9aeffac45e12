// SPDX-License-Identifier: Apache-2.0
// Sums over the pixels of a sub-tile of what its fragments have, as matrix products on tensor cores.
// Each lane of a warp has a pixel, and goes through 16 listed splats. With f = dL/dE, the gradient by
// the exponent of a fragment, and w = T alpha, its weight,
//
//   sum f {1, x, y, x^2, x y, y^2}   x, y from the sub-tile's center
//   sum w g                          g of each pixel, such as dL/d(pixel)
//
// are [splats x pixels] [pixels x 6] and [splats x pixels] [pixels x columns]. x and y are multiples
// of 1/2 below 4, so that the first right-hand side is exact in TF32. The left-hand sides are split
// into two TF32 parts, so that only the sums are rounded.
//
// A warp looks at 32 splats of its part of the tile at a time, and lists those that hit its sub-tile
// until there are the 16 of a product. Its lanes then take two splats in each step of their loop,
// without a branch: a fragment that is not kept has f = w = 0. f and w of the two lie side by side
// in shared memory, which is the order in which a lane's registers hold the left-hand side of a
// product.
#pragma once

#include "cuda/device/mma.cuh"
#include "cuda/render/blend/subtile.cuh"
#include "cuda/stages.cuh"

namespace gs::cuda {

inline constexpr int kProductSplats = 16;    // of one product
inline constexpr int kProducts = kWarp / 8;  // of 8 pixels each
inline constexpr int kPairStride = 2 * 8;    // floats: two splats at the pixels of a product
inline constexpr int kLeftStride = kProductSplats / 2 * kPairStride;  // floats: a left-hand side

/// Where the left-hand sides of product q begin, f and then w. Those of odd products lie 16 banks
/// apart from those of even ones, because half a warp writes both at a time.
constexpr int place_of_f(int q) { return q / 2 * kLeftStride + q % 2 * (4 * kLeftStride + 16); }
constexpr int place_of_w(int q) { return place_of_f(q) + 2 * kLeftStride; }

/// Places of the ring of listed splats: for a product that is not full yet, and for the next 32.
inline constexpr int kListed = kProductSplats + kWarp;

/// This lane's part of the right-hand side of the moments, column l / 4: x^a y^b, a + b <= 2. Row t
/// of product q is pixel 8 q + 2 t of the sub-tile, and row t + 4 is the next pixel, so that a lane
/// reads f of two splats at both pixels in 16 consecutive bytes, and w as well.
struct Monomials {
  float x[2];        // x^a of the columns 2 t and 2 t + 1
  float y[2], sign;  // y^b of the first two rows; times `sign`, mirrored, of the last two

  __device__ Monomials() {
    static_assert(kSubtileWidth == 8 && kSubtileHeight == kProducts && kProducts == 4);
    const int column = lane_of_thread() / 4, t = lane_of_thread() % 4;
    const int a = column == 3 ? 2 : column == 1 || column == 4 ? 1 : 0;
    const int b = column == 5 ? 2 : column == 2 || column == 4 ? 1 : 0;
    for (int k = 0; k < 2; ++k) {
      x[k] = power(float(2 * t + k) - 3.5f, a) * (column < 6 ? 1.0f : 0.0f);
      y[k] = power(float(k) - 1.5f, b);
    }
    sign = b == 1 ? -1.0f : 1.0f;
  }
  __device__ float y_of_row(int q) const { return q < 2 ? y[q] : sign * y[3 - q]; }

 private:
  __device__ static float power(float base, int n) {
    return n == 0 ? 1.0f : n == 1 ? base : base * base;
  }
};

/// dL/d(splat) from the sums over the pixels of one sub-tile. preprocess_backward() masks the colors
/// later.
__device__ inline SplatGradientSum splat_gradient(const ListedSplat& splat, const Vec2f& center,
                                           const float* sums) {
  const float4 a = *reinterpret_cast<const float4*>(sums);
  const float4 b = *reinterpret_cast<const float4*>(sums + 4);
  const float4 c = *reinterpret_cast<const float4*>(sums + 8);
  const float4 d = *reinterpret_cast<const float4*>(sums + 12);
  // From moments about the sub-tile's center to moments about the splat's mean.
  const float f = a.x, mx = splat.mean2d.x - center.x, my = splat.mean2d.y - center.y;
  const float fx = a.y - mx * f, fy = a.z - my * f;
  const float fxx = a.w - mx * (a.y + fx), fxy = b.x - mx * a.z - my * fx,
              fyy = b.y - my * (a.z + fy);
  const Sym2<float> Q = conic_of(splat.L);
  return {{Q.xx * fx + Q.xy * fy, Q.xy * fx + Q.yy * fy},  -0.5f * fxx, -0.5f * fxy, -0.5f * fyy,
          splat.opacity > 0.0f ? f / splat.opacity : 0.0f, c.x + c.w,   c.y + d.x,   c.z + d.y};
}

/// The whole warp: |dL/d(mean)| of a splat summed over its pixels, axis by axis, from each one's f
/// at d = (dx, dy).
__device__ inline Vec2f absolute_gradient(const ListedSplat& splat, float dx, float dy, float f) {
  const Sym2<float> Q = conic_of(splat.L);
  return {warp_sum(fabsf(f * (Q.xx * dx + Q.xy * dy))),
          warp_sum(fabsf(f * (Q.xy * dx + Q.yy * dy)))};
}

/// The whole warp: lists those of the walk's next 32 splats that hit the sub-tile, from a place of
/// the ring on, and returns their number.
template <class Listed, class Walk>
__device__ int list_next(Listed* ring, int place, Walk& walk, const PixelRange& pixels) {
  constexpr bool with_depth = std::is_same_v<Listed, ListedSplatWithDepth>;
  Listed splat_of_lane;
  bool is_hit = false;
  walk.take_next([&](int, const Splat& splat, std::uint32_t position, std::uint32_t gaussian) {
    is_hit = pixels.are_hit_by(splat);
    splat_of_lane = listed_as<with_depth>(splat, position, gaussian, walk.least_color());
  });
  const unsigned hits = __ballot_sync(kAllLanes, is_hit);
  place += __popc(hits & lanes_below());
  if (is_hit) ring[place < kListed ? place : place - kListed] = splat_of_lane;
  return __popc(hits);
}

}  // namespace gs::cuda
