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
#include "cuda/gradients/pixel_order.cuh"
#include "cuda/gradients/splat_shares.cuh"

namespace gs::cuda {
namespace {

constexpr int kBlocks = 6;  // per multiprocessor, as many as registers and memory allow

using Walk = PartWalkOf<Splat, kTileWidth, true, std::uint16_t>;
static_assert(kSegmentLength <= 65536);  // a walk of 16 bits

template <bool with_depth>
struct WarpShared {
  Listed<with_depth> list[kListed];
  Walk::Ahead ahead;
  ProductFragments fragments;
  ProductColors<with_depth> colors;
};

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
  write_colors(shared.colors, pixel);
  const Monomials monomials;
  const Vec2f center{float(subtile.x0) + 0.5f * kSubtileWidth,
                     float(subtile.y0) + 0.5f * kSubtileHeight};
  const float x = float(subtile.x) + 0.5f, y = float(subtile.y) + 0.5f;
  float* const left = shared.fragments.of + place_of_f(lane / 8) + 2 * (lane % 8);
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
    add_shares(shared.fragments, shared.colors, list, count, of_lane, monomials, center, sums);
    listed -= count;
    list = list + kProductSplats < shared.list + kListed ? list + kProductSplats : shared.list;
  }
}

// Moves the fixed-point sums of visible Gaussians to the floats that preprocess_backward() reads.
__global__ void __launch_bounds__(kBlendThreads)
    collect_sums_kernel(std::size_t count, const std::uint32_t* tile_counts, FineSums* all_fine,
                        CoarseSums* all_coarse, SplatGradientSum* gradients) {
  const std::size_t i = std::size_t(blockIdx.x) * kBlendThreads + threadIdx.x;
  if (i >= count || tile_counts[i] == 0) return;
  const FineSums fine = load_in_vectors(all_fine + i);
  const auto number = [&](int k) { return sum_of(fine, all_coarse + i, k); };
  const SplatGradientSum sum{{number(0), number(1)},
                             number(2),
                             number(3),
                             number(4),
                             number(5),
                             number(6),
                             number(7),
                             number(8),
                             number(9),
                             number(10),
                             number(11)};
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
    using Sums = std::remove_cvref_t<decltype(sums)>;
    const PictureGradientPointers by{dL.image.data, dL.alpha.data, dL.depth.data};
    with_rule(settings.blend_rule, [&](auto rule) {
      if (is_by_pixel(pass))
        context.launch("blend backward", blend_backward_by_pixel_kernel<rule(), Sums>,
                       pixel_order_blocks(pass.tile_count()), kPixelOrderThreads, tile_lists(pass),
                       pass.ray_depths.data(), scratch.order(), Background(settings), forward, by,
                       sums);
      else
        context.launch("blend backward", blend_backward_kernel<rule(), Sums>,
                       blend_blocks(scratch.segments.size()), kBlendThreads, tile_lists(pass),
                       scratch.segments.data(), Background(settings), forward, by, sums);
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
  with_constant(settings.absolute_gradient ||
                    (with_forces && (settings.blends_depth || settings.blends_surface)),
                [&](auto absolute) {
                  with_constant(with_depth, [&](auto depth) { launch_as_asked(absolute, depth); });
                });
}

}  // namespace gs::cuda
