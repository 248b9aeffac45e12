// SPDX-License-Identifier: Apache-2.0
// What the kernels of stage 6 share: the state of a pixel while it walks through its fragments, and
// how a warp sums what 16 splats have of its pixels, by the products of fragment_products.cuh.
#pragma once

#include "cuda/gradients/gradient_sums.cuh"
#include "cuda/render/blend/fragment_products.cuh"

namespace gs::cuda {

inline constexpr int kColorStride = kWarp + 8;  // floats; columns are 8 banks apart
inline constexpr int kSecondAt = 16;  // the place of FragmentSums::second among a splat's sums

/// Columns of the colors' right-hand side that are in use.
template <bool with_depth>
inline constexpr int kColorColumns = with_depth ? 8 : 6;

/// The left-hand sides of 16 splats: f and w at each pixel; then the sums over the pixels.
struct alignas(16) ProductFragments {
  float of[place_of_w(kProducts - 1) + kLeftStride];
};
/// The right-hand side of the colors, by columns.
template <bool with_depth>
struct alignas(8) ProductColors {
  float of[kColorColumns<with_depth>][kColorStride];
};

/// The results of the forward pass.
struct Forward {
  const float* image;                      // (3, H, W)
  const float* transmittance;              // (H, W)
  const std::uint32_t* last;               // (H, W)
  const std::uint32_t* first_checkpoints;  // (tiles)
  const Vec4f* checkpoints;                // (.., pixels of a tile)
  const float* depth;                      // (H, W)
  const float* depth_checkpoints;          // (.., pixels of a tile)
};
/// A PictureGradient as a kernel gets it.
struct PictureGradientPointers {
  const float *image, *alpha, *depth;
};

/// The state of one pixel during the walk. gs_core/math/render/blend.h has the same formulas with
/// the color behind a fragment; here its inner product with dL/d(pixel) is enough.
template <bool with_depth>
struct PixelWalk {
  Vec3f dL_dpixel{0, 0, 0};
  float dL_ddepth = 0;
  float behind = 0;       // <color behind without background, dL/dpixel> - background_term
  float last_behind = 0;  // the same behind the last fragment: -background_term
  float transmittance = 1;
  int last = -1;  // the position of the last fragment

  __device__ PixelWalk(const TileLists& lists, const Subtile& subtile, const Vec3f& background,
                       const Forward& forward, const PictureGradientPointers& dL) {
    if (!subtile.is_inside) return;
    const std::size_t at = subtile.pixel(lists), plane = std::size_t(lists.width) * lists.height;
    const float* const image = forward.image + at;
    dL_dpixel = {dL.image[at], dL.image[plane + at], dL.image[2 * plane + at]};
    behind = inner(dL_dpixel, Vec3f(image[0], image[plane], image[2 * plane]));
    last_behind = forward.transmittance[at] * inner(dL_dpixel, background);
    if (dL.alpha) {  // as a color of -dL/d(alpha) behind everything
      const float by_alpha = forward.transmittance[at] * dL.alpha[at];
      behind -= by_alpha;
      last_behind -= by_alpha;
    }
    if constexpr (with_depth) {
      dL_ddepth = dL.depth[at];
      behind = fmaf(dL_ddepth, forward.depth[at], behind);
    }
    last = int(forward.last[at]) - 1;
  }

  /// Skips to a later segment, before which `at` has color, transmittance and depth.
  __device__ void skip_to(const Forward& forward, std::size_t at) {
    const Vec4f& checkpoint = forward.checkpoints[at];
    behind -= inner(dL_dpixel, Vec3f(checkpoint.x, checkpoint.y, checkpoint.z));
    if constexpr (with_depth) behind -= dL_ddepth * forward.depth_checkpoints[at];
    transmittance = checkpoint.w;
  }

  /// Returns f and w of a fragment, and advances past it. A fragment that is not kept has opacity 0:
  /// f and w are 0 and the state stays as it is, without a branch.
  template <BlendRule rule>
  __device__ float2 step(const Listed<with_depth>& splat, float e, bool is_kept) {
    const float opacity = is_kept ? splat.opacity : 0.0f, gaussian = exp2_fragment(e);
    const float alpha = fragment_alpha<rule>(opacity, gaussian);
    return advance(splat, alpha,
                   rule == BlendRule::classic && opacity * gaussian > kMaxAlphaClassic,
                   int(splat.position) == last);
  }
  /// The same of a fragment's alpha. `is_clamped`: by the classic rule.
  __device__ float2 advance(const Listed<with_depth>& splat, float alpha, bool is_clamped,
                            bool is_last) {
    const float weight = transmittance * alpha;
    float shade =
        fmaf(splat.red, dL_dpixel.x, fmaf(splat.green, dL_dpixel.y, splat.blue * dL_dpixel.z));
    if constexpr (with_depth) shade = fmaf(splat.depth, dL_ddepth, shade);
    behind = is_last ? last_behind : fmaf(-weight, shade, behind);
    const float q = 1.0f / fmaxf(1.0f - alpha, kMinOneMinusAlpha);
    float f = fmaf(weight, shade, -alpha * q * behind);
    if (is_clamped) f = 0.0f;
    transmittance = transmittance * (1.0f - alpha);
    return {f, weight};
  }
};

/// Writes this lane's row of the right-hand side of the colors: red, green and blue of dL/d(pixel),
/// which a product cuts off to TF32, the rest of each, and the same of the depth.
template <bool with_depth>
__device__ void write_colors(ProductColors<with_depth>& colors,
                             const PixelWalk<with_depth>& pixel) {
  const int lane = lane_of_thread();
  for (int c = 0; c < 3; ++c) {
    colors.of[c][lane] = pixel.dL_dpixel[c];
    colors.of[3 + c][lane] = pixel.dL_dpixel[c] - tf32_part(pixel.dL_dpixel[c]);
  }
  if constexpr (with_depth) {
    colors.of[6][lane] = pixel.dL_ddepth;
    colors.of[7][lane] = pixel.dL_ddepth - tf32_part(pixel.dL_ddepth);
  }
}

/// FragmentSums::second of the splats 2 g and 2 g + 1 over the pixels that this lane loads.
struct SecondSums {
  float first = 0, second = 0;

  // Left-hand sides of f.
  __device__ void add(const float4& f) {
    first = fmaf(f.x, f.x, fmaf(f.z, f.z, first));
    second = fmaf(f.y, f.y, fmaf(f.w, f.w, second));
  }
  /// The four lanes with the same g: the sum over all pixels, of splat 2 g in even lanes and of
  /// 2 g + 1 in odd ones.
  __device__ float total() const {
    const bool is_odd = lane_of_thread() % 2;
    const float given = __shfl_xor_sync(kAllLanes, is_odd ? first : second, 1);
    const float pair = (is_odd ? second : first) + given;
    return pair + __shfl_xor_sync(kAllLanes, pair, 2);
  }
};

/// What lane k knows of the k-th splat, where asked for.
struct SplatOfLane {
  Vec2f absolute{0, 0};  // its absolute gradient
  unsigned kept = 0;     // the pixels of its fragments, a bit each
};

/// The whole warp: sums f and w of up to 16 splats over the pixels, and adds each splat's share to
/// the sums of its Gaussian. Splats 2 g and 2 g + 1 are rows g and g + 8 of the products.
template <class Sums, class Listed>
__device__ void add_shares(ProductFragments& fragments, const ProductColors<Sums::kDepth>& columns,
                           const Listed* list, int count, const SplatOfLane& of_lane,
                           const Monomials& monomials, const Vec2f& center, const Sums& sums) {
  constexpr bool kHasFragments = Sums::kStatistic != FragmentStatistic::none;
  const int lane = lane_of_thread(), g = lane / 4, t = lane % 4;
  __syncwarp();
  const float* const column = columns.of[min(g, kColorColumns<Sums::kDepth> - 1)] + 2 * t;
  SecondSums seconds;
  float moments[4] = {}, colors[4] = {};
#pragma unroll
  for (int q = 0; q < kProducts; ++q) {
    const float4 f = *reinterpret_cast<const float4*>(fragments.of + place_of_f(q) + 4 * lane);
    const float4 w = *reinterpret_cast<const float4*>(fragments.of + place_of_w(q) + 4 * lane);
    const float y = monomials.y_of_row(q);
    const float2 color = *reinterpret_cast<const float2*>(column + 8 * q);
    multiply_add_exactly(moments, {f.x, f.y, f.z, f.w}, {monomials.x[0] * y, monomials.x[1] * y});
    multiply_add_exactly(colors, {w.x, w.y, w.z, w.w}, {color.x, color.y});
    if (kHasFragments) seconds.add(f);
  }
  [[maybe_unused]] const float second = kHasFragments ? seconds.total() : 0.0f;
  __syncwarp();
  float* const to = fragments.of + 2 * g * kSumStride + 2 * t;
  *reinterpret_cast<float2*>(to) = {moments[0], moments[1]};
  *reinterpret_cast<float2*>(to + 8) = {colors[0], colors[1]};
  *reinterpret_cast<float2*>(to + kSumStride) = {moments[2], moments[3]};
  *reinterpret_cast<float2*>(to + kSumStride + 8) = {colors[2], colors[3]};
  if (kHasFragments && t < 2) fragments.of[(2 * g + t) * kSumStride + kSecondAt] = second;
  __syncwarp();
  std::uint32_t gaussian = 0;
  SplatShare share;
  if (lane < count) {
    const Listed splat = list[lane];
    const float* const of_splat = fragments.of + lane * kSumStride;
    gaussian = splat.gaussian;
    share.gradient = splat_gradient(splat, center, of_splat);
    if (Sums::kDepth) share.gradient.depth = of_splat[14] + of_splat[15];
    if (Sums::kAbsolute)
      share.gradient.absolute_x = of_lane.absolute.x,
      share.gradient.absolute_y = of_lane.absolute.y;
    if (kHasFragments)
      share.fragments = {float(__popc(of_lane.kept)), of_splat[0], of_splat[kSecondAt]};
  }
  sums.add(count, gaussian, share, fragments.of);
  __syncwarp();
}

}  // namespace gs::cuda
