// SPDX-License-Identifier: Apache-2.0
// Stage 4: blend each tile's list of splats front to back, one pixel per lane. subtile.cuh
// describes the work of a warp. GPUs with tensor cores use blend_gemm.cu instead.   Kerbl et al.
// 2023, Eq. 3
#include "cuda/render/blend/subtile.cuh"
#include "cuda/stages.cuh"

namespace gs::cuda {
namespace {

constexpr int kBlocks = 10;  // per multiprocessor, as many as registers allow

struct Checkpoints {
  const std::uint32_t* first;  // (tiles)
  Vec4f* of;                   // (.., pixels of a tile); null: none are wanted
  float* depths;               // (.., pixels of a tile)
};

template <bool with_depth>
struct WarpShared {
  Listed<with_depth> list[kWarp];
  ListWalk::Ahead ahead;
};

template <BlendRule rule, bool with_depth>
__global__ void __launch_bounds__(kBlendThreads, kBlocks)
    blend_kernel(TileLists lists, const std::uint32_t* tile_order, Background background,
                 Pictures pictures, Checkpoints checkpoints) {
  __shared__ WarpShared<with_depth> shared_of_warps[kBlendWarps];
  WarpShared<with_depth>& shared = shared_of_warps[threadIdx.x / kWarp];
  const WarpWork work;
  const Subtile subtile(lists, tile_of(tile_order, work.item), work.subtile);
  if (subtile.x0 >= lists.width || subtile.y0 >= lists.height) return;  // the whole warp

  PixelState<float> pixel;
  bool is_open = subtile.is_inside;  // takes further fragments
  std::uint32_t last = 0;
  float depth = 0;
  const float x = float(subtile.x) + 0.5f, y = float(subtile.y) + 0.5f;
  const std::uint32_t length = lists.ranges[subtile.tile + 1] - lists.ranges[subtile.tile];
  for (ListWalk walk(shared.ahead, lists, subtile.tile, subtile.pixels(), 0, length,
                     checkpoints.of != nullptr);
       !walk.is_done();) {
    if (!__any_sync(kAllLanes, is_open)) break;
    if (walk.segment_is_done()) {
      const std::size_t at =
          subtile.checkpoint(checkpoints.first[subtile.tile] + walk.next_segment() - 1);
      checkpoints.of[at] = {pixel.color.x, pixel.color.y, pixel.color.z, pixel.transmittance};
      if constexpr (with_depth) checkpoints.depths[at] = depth;
    }
    const int count = walk.list_next(shared.list);
    for (int i = 0; i < count; ++i) {
      const Listed<with_depth> splat = shared.list[i];
      const float e = base2_exponent(splat, x - splat.mean2d.x, y - splat.mean2d.y);
      if (!is_open || e < splat.lowest) continue;
      const float alpha = fragment_alpha<rule>(splat.opacity, exp2_fragment(e));
      if (rule == BlendRule::classic && is_opaque(pixel.transmittance * (1.0f - alpha))) {
        is_open = false;
        continue;
      }
      if constexpr (with_depth) depth = fmaf(pixel.transmittance * alpha, splat.depth, depth);
      composite(pixel, {splat.red, splat.green, splat.blue}, alpha);
      last = splat.position + 1;
      if (rule == BlendRule::faster_gs && is_opaque(pixel.transmittance)) is_open = false;
    }
    __syncwarp();
  }
  pictures.write<with_depth>(lists, subtile, background(), pixel, last, depth);
}

}  // namespace

void blend(Context& context, const RenderSettings& settings, RenderPass& pass) {
  const StageScope scope(context, "blend");
  pass.image.resize_discard(3 * pass.pixel_count());
  pass.transmittance.resize_discard(pass.pixel_count());
  pass.last_instance.resize_discard(pass.pixel_count());
  pass.depth_image.resize_discard(settings.blends_depth ? pass.pixel_count() : 0);
  if (is_by_pixel(pass)) return blend_by_pixel(context, settings, pass);
  if (blends_on_tensor_cores(context, settings)) return blend_gemm(context, settings, pass);
  const CudaScratch& scratch = pass.scratch<CudaScratch>();
  const Checkpoints checkpoints{scratch.first_checkpoints.data(),
                                settings.for_backward ? scratch.checkpoints() : nullptr,
                                scratch.depth_checkpoints.data()};
  with_rule(settings.blend_rule, [&](auto rule) {
    with_constant(settings.blends_depth, [&](auto depth) {
      context.launch("blend", blend_kernel<rule(), depth()>, blend_blocks(pass.tile_count()),
                     kBlendThreads, tile_lists(pass), scratch.order(), Background(settings),
                     Pictures(pass), checkpoints);
    });
  });
}

}  // namespace gs::cuda
