// SPDX-License-Identifier: Apache-2.0
// Stage 6: the gradients of blending, front to back again. subtile.cuh describes the work of a
// warp.
//
// A lane goes through the listed splats for its pixel and computes two numbers for each: f = dL/dE,
// the gradient by the exponent, and w = T alpha, the weight. The gradient of a splat follows from
// sums of these over the pixels, which are the products of fragment_products.cuh: sum f times the
// monomials for mean, conic and opacity, and sum w dL/d(pixel) for its color.
//
// The score "force" of density control (FragmentSums) costs little more: sum f is one of the moments,
// and sum f^2 is summed from the registers that the products load.
#include "cuda/gradients/gradient_sums.cuh"
#include "cuda/render/blend/fragment_products.cuh"

namespace gs::cuda {
namespace {

constexpr int kBlocks = 6;            // per multiprocessor, as many as registers and memory allow
constexpr int kColorStride = kWarp + 8;                        // floats; columns are 8 banks apart
constexpr int kSecondAt = 16;  // the place of FragmentSums::second among a splat's sums

using Walk = PartWalkOf<Splat, kTileWidth, true, std::uint16_t>;
static_assert(kSegmentLength <= 65536);  // a walk of 16 bits

// Columns of the colors' right-hand side that are in use.
template <bool with_depth>
constexpr int kColorColumns = with_depth ? 8 : 6;

template <bool with_depth>
struct WarpShared {
  Listed<with_depth> list[kListed];
  Walk::Ahead ahead;
  // the left-hand sides: f and w of 16 splats at each pixel; then the sums over the pixels
  alignas(16) float fragments[place_of_w(kProducts - 1) + kLeftStride];
  alignas(
      8) float colors[kColorColumns<with_depth>][kColorStride];  // the right-hand side, by columns
};

// The results of the forward pass.
struct Forward {
  const float* image;                      // (3, H, W)
  const float* transmittance;              // (H, W)
  const std::uint32_t* last;               // (H, W)
  const std::uint32_t* first_checkpoints;  // (tiles)
  const Vec4f* checkpoints;                // (.., pixels of a tile)
  const float* depth;                      // (H, W)
  const float* depth_checkpoints;          // (.., pixels of a tile)
};
// A PictureGradient as a kernel gets it.
struct PictureGradientPointers {
  const float *image, *alpha, *depth;
};

// The state of one pixel during the walk. gs_core/math/render/blend.h has the same formulas with
// the color behind a fragment; here its inner product with dL/d(pixel) is enough.
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
    const float weight = transmittance * alpha;
    float shade =
        fmaf(splat.red, dL_dpixel.x, fmaf(splat.green, dL_dpixel.y, splat.blue * dL_dpixel.z));
    if constexpr (with_depth) shade = fmaf(splat.depth, dL_ddepth, shade);
    behind = int(splat.position) == last ? last_behind : fmaf(-weight, shade, behind);
    const float q = 1.0f / fmaxf(1.0f - alpha, kMinOneMinusAlpha);
    float f = fmaf(weight, shade, -alpha * q * behind);
    if (rule == BlendRule::classic && opacity * gaussian > kMaxAlphaClassic) f = 0.0f;
    transmittance = transmittance * (1.0f - alpha);
    return {f, weight};
  }
};

// Writes this lane's row of the right-hand side of the colors: red, green and blue of dL/d(pixel),
// which a product cuts off to TF32, the rest of each, and the same of the depth.
template <bool with_depth>
__device__ void write_colors(WarpShared<with_depth>& shared, const PixelWalk<with_depth>& pixel) {
  const int lane = lane_of_thread();
  for (int c = 0; c < 3; ++c) {
    shared.colors[c][lane] = pixel.dL_dpixel[c];
    shared.colors[3 + c][lane] = pixel.dL_dpixel[c] - tf32_part(pixel.dL_dpixel[c]);
  }
  if constexpr (with_depth) {
    shared.colors[6][lane] = pixel.dL_ddepth;
    shared.colors[7][lane] = pixel.dL_ddepth - tf32_part(pixel.dL_ddepth);
  }
}

// FragmentSums::second of the splats 2 g and 2 g + 1 over the pixels that this lane loads.
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

// What lane k knows of the k-th splat, where asked for.
struct SplatOfLane {
  Vec2f absolute{0, 0};  // its absolute gradient
  unsigned kept = 0;     // the pixels of its fragments, a bit each
};

// The whole warp: sums f and w of up to 16 splats over the pixels, and adds each splat's share to
// the sums of its Gaussian. Splats 2 g and 2 g + 1 are rows g and g + 8 of the products.
template <class Sums, class Shared, class Listed>
__device__ void add_shares(Shared& shared, const Listed* list, int count,
                           const SplatOfLane& of_lane, const Monomials& monomials,
                           const Vec2f& center, const Sums& sums) {
  constexpr bool kHasFragments = Sums::kStatistic != FragmentStatistic::none;
  const int lane = lane_of_thread(), g = lane / 4, t = lane % 4;
  __syncwarp();
  const float* const column = shared.colors[min(g, kColorColumns<Sums::kDepth> - 1)] + 2 * t;
  SecondSums seconds;
  float moments[4] = {}, colors[4] = {};
#pragma unroll
  for (int q = 0; q < kProducts; ++q) {
    const float4 f = *reinterpret_cast<const float4*>(shared.fragments + place_of_f(q) + 4 * lane);
    const float4 w = *reinterpret_cast<const float4*>(shared.fragments + place_of_w(q) + 4 * lane);
    const float y = monomials.y_of_row(q);
    const float2 color = *reinterpret_cast<const float2*>(column + 8 * q);
    multiply_add_exactly(moments, {f.x, f.y, f.z, f.w}, {monomials.x[0] * y, monomials.x[1] * y});
    multiply_add_exactly(colors, {w.x, w.y, w.z, w.w}, {color.x, color.y});
    if (kHasFragments) seconds.add(f);
  }
  [[maybe_unused]] const float second = kHasFragments ? seconds.total() : 0.0f;
  __syncwarp();
  float* const to = shared.fragments + 2 * g * kSumStride + 2 * t;
  *reinterpret_cast<float2*>(to) = {moments[0], moments[1]};
  *reinterpret_cast<float2*>(to + 8) = {colors[0], colors[1]};
  *reinterpret_cast<float2*>(to + kSumStride) = {moments[2], moments[3]};
  *reinterpret_cast<float2*>(to + kSumStride + 8) = {colors[2], colors[3]};
  if (kHasFragments && t < 2) shared.fragments[(2 * g + t) * kSumStride + kSecondAt] = second;
  __syncwarp();
  std::uint32_t gaussian = 0;
  SplatShare share;
  if (lane < count) {
    const Listed splat = list[lane];
    const float* const of_splat = shared.fragments + lane * kSumStride;
    gaussian = splat.gaussian;
    share.gradient = splat_gradient(splat, center, of_splat);
    if (Sums::kDepth) share.gradient.depth = of_splat[14] + of_splat[15];
    if (Sums::kAbsolute)
      share.gradient.absolute_x = of_lane.absolute.x,
      share.gradient.absolute_y = of_lane.absolute.y;
    if (kHasFragments)
      share.fragments = {float(__popc(of_lane.kept)), of_splat[0], of_splat[kSecondAt]};
  }
  sums.add(count, gaussian, share, shared.fragments);
  __syncwarp();
}

template <BlendRule rule, class Sums>
__global__ void __launch_bounds__(kBlendThreads, kBlocks)
    blend_backward_kernel(TileLists lists, const ListSegment* segments, Background background,
                          Forward forward, PictureGradientPointers dL, Sums sums) {
  constexpr bool kHasFragments = Sums::kStatistic != FragmentStatistic::none;
  using Listed = Listed<Sums::kDepth>;
  __shared__ WarpShared<Sums::kDepth> shared_of_warps[kBlendWarps];
  WarpShared<Sums::kDepth>& shared = shared_of_warps[threadIdx.x / kWarp];
  const int lane = lane_of_thread();
  const WarpWork work;
  const ListSegment segment = segments[work.item];
  if (segment.tile == kNoTile) return;
  const Subtile subtile(lists, segment.tile, work.subtile);
  PixelWalk<Sums::kDepth> pixel(lists, subtile, background(), forward, dL);
  const std::uint32_t longest = warp_max(std::uint32_t(pixel.last + 1)),
                      first = segment.number * kSegmentLength;
  if (longest <= first) return;
  if (segment.number > 0)
    pixel.skip_to(forward,
                  subtile.checkpoint(forward.first_checkpoints[segment.tile] + segment.number - 1));
  write_colors(shared, pixel);
  const Monomials monomials;
  const Vec2f center{float(subtile.x0) + 0.5f * kSubtileWidth,
                     float(subtile.y0) + 0.5f * kSubtileHeight};
  const float x = float(subtile.x) + 0.5f, y = float(subtile.y) + 0.5f;
  float* const left = shared.fragments + place_of_f(lane / 8) + 2 * (lane % 8);
  const PixelRange pixels = subtile.pixels();
  Walk walk(shared.ahead, lists, subtile.tile, pixels.bit(), first,
            min(longest, first + kSegmentLength), false);
  Listed* list = shared.list;  // where the next product begins
  int listed = 0;              // splats from there on
  while (true) {
    while (listed < kProductSplats && !walk.is_done())
      listed += list_next(shared.list, int(list - shared.list) + listed, walk, pixels);
    if (listed == 0) break;
    const int count = min(listed, kProductSplats);
    if (lane == 0 && count % 2) list[count] = {};  // the other one of a pair
    __syncwarp();
    SplatOfLane of_lane;
    const auto step = [&](int k, const Listed& splat) {
      const float dx = x - splat.mean2d.x, dy = y - splat.mean2d.y;
      const float e = base2_exponent(splat, dx, dy);
      const bool is_kept = e >= splat.lowest && int(splat.position) <= pixel.last;
      const float2 fragment = pixel.template step<rule>(splat, e, is_kept);
      if (Sums::kAbsolute) {
        const Vec2f sum = absolute_gradient(splat, dx, dy, fragment.x);
        if (lane == k) of_lane.absolute = sum;
      }
      if (kHasFragments) {
        const unsigned kept = __ballot_sync(kAllLanes, is_kept);
        if (lane == k) of_lane.kept = kept;
      }
      return fragment;
    };
    float* to = left;
#pragma unroll 1
    for (int k = 0; k < count; k += 2, to += kPairStride) {
      const Listed one = list[k], other = list[k + 1];
      const float2 a = step(k, one), b = step(k + 1, other);
      *reinterpret_cast<float2*>(to) = {a.x, b.x};
      *reinterpret_cast<float2*>(to + place_of_w(0)) = {a.y, b.y};
    }
    add_shares(shared, list, count, of_lane, monomials, center, sums);
    listed -= count;
    list = list + kProductSplats < shared.list + kListed ? list + kProductSplats : shared.list;
  }
}

// Adds the fixed-point sums of visible Gaussians to the floats that preprocess_backward() reads,
// which are zero but for photos with a depth map, and clears them.
__global__ void __launch_bounds__(kBlendThreads)
    collect_sums_kernel(std::size_t count, const std::uint32_t* tile_counts, FineSums* all_fine,
                        CoarseSums* all_coarse, SplatGradientSum* gradients) {
  const std::size_t i = std::size_t(blockIdx.x) * kBlendThreads + threadIdx.x;
  if (i >= count || tile_counts[i] == 0) return;
  const FineSums fine = load_in_vectors(all_fine + i);
  const auto number = [&](int k) { return sum_of(fine, all_coarse + i, k); };
  SplatGradientSum sum = load_in_vectors(gradients + i);
  sum.mean2d += Vec2f(number(0), number(1));
  sum.conic_xx += number(2), sum.conic_xy += number(3), sum.conic_yy += number(4);
  sum.opacity += number(5);
  sum.red += number(6), sum.green += number(7), sum.blue += number(8);
  sum.absolute_x += number(9), sum.absolute_y += number(10), sum.depth += number(11);
  store_in_vectors(gradients + i, sum);
  store_in_vectors(all_fine + i, FineSums{});
  if (fine.has_coarse) all_coarse[i] = {};
}

}  // namespace

void blend_backward(Context& context, const RenderSettings& settings, const PictureGradient& dL,
                    Workspace& workspace, const RenderPass& pass) {
  const StageScope scope(context, "blend backward");
  GS_CHECK(dL.image.size == 3 * pass.pixel_count());
  GS_CHECK(dL.alpha.empty() || dL.alpha.size == pass.pixel_count());
  GS_CHECK(dL.depth.empty() || dL.depth.size == pass.depth_image.size());
  const CudaScratch& scratch = pass.scratch<CudaScratch>();
  const Forward forward{pass.image.data(),
                        pass.transmittance.data(),
                        pass.last_instance.data(),
                        scratch.first_checkpoints.data(),
                        scratch.checkpoints(),
                        pass.depth_image.data(),
                        scratch.depth_checkpoints.data()};
  const auto launch = [&](const auto& sums) {
    with_rule(settings.blend_rule, [&](auto rule) {
      context.launch("blend backward",
                     blend_backward_kernel<rule(), std::remove_cvref_t<decltype(sums)>>,
                     blend_blocks(scratch.segments.size()), kBlendThreads, tile_lists(pass),
                     scratch.segments.data(), Background(settings), forward,
                     PictureGradientPointers{dL.image.data, dL.alpha.data, dL.depth.data}, sums);
    });
  };
  const FragmentSink fragments{
      settings.deterministic ? nullptr : workspace.fragment_sums.data(),
      settings.deterministic ? workspace.fixed_fragment_sums.data() : nullptr,
      force_scale(pass.pixel_count())};
  // With depths, forces are only summed beside absolute gradients, so that there are fewer kernels.
  const bool with_forces = settings.fragment_statistic != FragmentStatistic::none;
  const auto launch_with = [&](const auto& sums) {
    using Sums = std::remove_cvref_t<decltype(sums)>;
    if (!with_forces) return launch(sums);
    if constexpr (std::is_same_v<Sums, FloatSums<false>>)
      return launch(FloatSumsOfForces{{sums.of_gaussian}});
    else if constexpr (!Sums::kDepth || Sums::kAbsolute)
      return launch(WithForces<Sums>{sums, fragments});
    else
      GS_CHECK(!"forces beside absolute gradients");
  };
  const auto launch_as_asked = [&](auto absolute, auto depth) {
    if (!settings.deterministic)
      return launch_with(FloatSums<absolute(), depth()>{workspace.splat_gradients.data()});
    launch_with(
        FixedSums<absolute(), depth()>{workspace.fine_sums.data(), workspace.coarse_sums.data()});
    const std::size_t count = pass.tile_counts.size();
    context.launch("collect sums", collect_sums_kernel, blocks_for(count, kBlendThreads),
                   kBlendThreads, count, pass.tile_counts.data(), workspace.fine_sums.data(),
                   workspace.coarse_sums.data(), workspace.splat_gradients.data());
  };
  const bool with_depth = !dL.depth.empty();
  // Forces that are not among the gradients are in sums of their own, beside absolute gradients.
  const bool has_forces_apart = with_forces && settings.with_depths && !settings.deterministic;
  with_constant(settings.absolute_gradient || has_forces_apart || (with_forces && with_depth),
                [&](auto absolute) {
                  with_constant(with_depth, [&](auto depth) { launch_as_asked(absolute, depth); });
                });
}

}  // namespace gs::cuda
