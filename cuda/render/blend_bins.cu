// SPDX-License-Identifier: Apache-2.0
// Stage 4 on tensor cores with lists by bins. It blends as blend_gemm.cu does, and each sub-tile
// has the same splats in the same order; only the walk to them differs (bin_walk.cuh). For frames
// of packed models, without history.
#include "cuda/render/bin_walk.cuh"
#include "cuda/render/gemm_pixels.cuh"

namespace gs::cuda {
namespace {

template <BlendRule rule, bool fast, int height>
struct Variant : PixelVariant<rule, false, fast, height> {
  using Walk = BinWalk<height == kTileHeight / 2>;
};

template <class Kind>
struct WarpShared {
  typename Kind::Queue::Shared queue;
  PixelShared<Kind::height, false> pixels;
  typename Kind::Walk::Ahead ahead;
};

struct Output {
  float* image;          // (3, H, W)
  float* transmittance;  // (H, W)
};

template <class Kind>
__global__ void __launch_bounds__(kBlendThreads, Kind::blocks)
    blend_bins_kernel(BinPicture lists, const std::uint32_t* order, Vec3f background, Output out) {
  __shared__ WarpShared<Kind> shared_of_warps[kBlendWarps];
  WarpShared<Kind>& shared = shared_of_warps[threadIdx.x / kWarp];
  // A sub-tile of 8 x 8 pixels has one warp, or two beside each other in the grid.
  constexpr std::uint32_t kParts = kSubtileSide / Kind::height;
  const std::uint32_t warp = blockIdx.x * kBlendWarps + threadIdx.x / kWarp;
  const std::uint32_t per_row = lists.subtiles_per_row, per_bin = per_row * per_row * kParts;
  const std::uint32_t bin = order[warp / per_bin];
  const int part = int(warp % kParts), subtile = int(warp % per_bin / kParts);
  const int side = lists.subtiles_per_row * kSubtileSide;
  const int x0 = int(bin) % lists.bins_x * side + subtile % int(per_row) * kSubtileSide;
  const int y0 =
      int(bin) / lists.bins_x * side + subtile / int(per_row) * kSubtileSide + part * Kind::height;
  if (x0 >= lists.width || y0 >= lists.height) return;  // the whole warp

  SubtilePixels<Kind> pixels(shared.pixels, lists, x0, y0);
  typename Kind::Queue queue(shared.queue,
                             {float(x0) + 0.5f * kSubtileWidth, float(y0) + 0.5f * Kind::height});
  typename Kind::Walk walk(shared.ahead, lists, bin, subtile,
                           PixelRange(x0, y0, kSubtileWidth, Kind::height));
  while (pixels.any_open()) {
    if (queue.count() >= kBatch || (queue.count() > 0 && walk.is_done())) {
      blend_next(queue, pixels);
      continue;
    }
    if (walk.is_done()) break;
    queue.take(walk);
  }

  // Each lane writes one plane: red, green, blue, or transmittance.
  const int x = x0 + pixels.column(), channel = pixels.owner();
  const std::size_t plane = std::size_t(lists.width) * lists.height;
  float* const to = channel == 3 ? out.transmittance : out.image + channel * plane;
  const float behind = channel == 0   ? background.x
                       : channel == 1 ? background.y
                       : channel == 2 ? background.z
                                      : 0.0f;
#pragma unroll 2
  for (int row = 0; row < Kind::height; ++row) {
    const float part_of_lane = pixels.part(row);
    const float transmittance = __shfl_sync(kAllLanes, part_of_lane, lane_of_thread() | 3);
    if (x < lists.width && y0 + row < lists.height)
      to[std::size_t(y0 + row) * lists.width + x] = fmaf(transmittance, behind, part_of_lane);
  }
}

BinPicture picture_of(const RenderPass& pass) {
  const CudaScratch& scratch = pass.scratch<CudaScratch>();
  const BinBuffers& bins = scratch.bins;
  return {pass.width,
          pass.height,
          bins.bins_x,
          bins.side / kSubtileSide,
          bins.ranges.data(),
          bins.first_groups.data(),
          bins.rows.data(),
          bins.words.data(),
          scratch.view_splats.data()};
}

}  // namespace

void blend_bins(Context& context, const RenderSettings& settings, RenderPass& pass) {
  const StageScope scope(context, "blend");
  pass.image.resize_discard(3 * pass.pixel_count());
  pass.transmittance.resize_discard(pass.pixel_count());
  pass.last_instance.resize_discard(0);
  const BinBuffers& bins = pass.scratch<CudaScratch>().bins;
  const BinPicture lists = picture_of(pass);
  const auto launch = [&](auto kind) {
    using Kind = decltype(kind);
    const std::size_t per_bin =
        std::size_t(bins.side / kSubtileWidth) * std::size_t(bins.side / Kind::height);
    context.launch("blend", blend_bins_kernel<Kind>, bins.count() * per_bin / kBlendWarps,
                   kBlendThreads, lists, bins.order.data(), settings.background,
                   Output{pass.image.data(), pass.transmittance.data()});
  };
  with_constant(has_small_subtiles(context, pass), [&](auto small) {
    with_rule_and_speed(settings, [&](auto rule, auto fast) {
      launch(Variant < rule(), fast(), small() ? 4 : 8 > ());
    });
  });
}

}  // namespace gs::cuda
