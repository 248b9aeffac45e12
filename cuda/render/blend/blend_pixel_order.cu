// SPDX-License-Identifier: Apache-2.0
// Stage 4 of the order by pixel: blends the fragments of each pixel in the order of their depths
// along its ray. pixel_order.cuh describes the work of a warp.   Radl et al. 2024 (StopThePop)
#include "cuda/render/blend/pixel_order.cuh"

namespace gs::cuda {
namespace {

template <BlendRule rule, bool with_depth>
__global__ void __launch_bounds__(kPixelOrderThreads)
    blend_by_pixel_kernel(TileLists lists, const RayDepth<float>* rays,
                          const std::uint32_t* tile_order, Background background,
                          Pictures pictures) {
  using Walk = PixelOrderWalk<with_depth>;
  __shared__ typename Walk::Shared shared;
  const std::uint32_t item = blockIdx.x / kSubtilesPerTile;
  const Subtile subtile(lists, tile_of(tile_order, item), int(blockIdx.x % kSubtilesPerTile));
  if (subtile.x0 >= lists.width || subtile.y0 >= lists.height) return;  // the whole warp
  const float x = float(subtile.x) + 0.5f, y = float(subtile.y) + 0.5f;
  PixelState<float> pixel;
  bool is_open = subtile.is_inside;  // takes further fragments
  std::uint32_t blended = 0;
  float depth = 0;
  Walk walk(shared, lists, rays, subtile);
  do {
    walk.take(
        is_open, [](int, const typename Walk::Listed&, float, bool) {},
        [&](int, const typename Walk::Listed& splat) {
          // Again, since alphas in shared memory would leave room for half as many warps.
          const float e = base2_exponent(splat, x - splat.mean2d.x, y - splat.mean2d.y);
          const float alpha = fragment_alpha<rule>(splat.opacity, exp2_fragment(e));
          if (rule == BlendRule::classic && is_opaque(pixel.transmittance * (1.0f - alpha)))
            is_open = false;
          if (!is_open) return;
          if constexpr (with_depth) depth = fmaf(pixel.transmittance * alpha, splat.depth, depth);
          composite(pixel, {splat.red, splat.green, splat.blue}, alpha);
          ++blended;
          if (rule == BlendRule::faster_gs && is_opaque(pixel.transmittance)) is_open = false;
        });
  } while (!walk.is_done() && __any_sync(kAllLanes, is_open));
  pictures.write<with_depth>(lists, subtile, background(), pixel, blended, depth);
}

}  // namespace

void blend_by_pixel(Context& context, const RenderSettings& settings, RenderPass& pass) {
  with_rule(settings.blend_rule, [&](auto rule) {
    with_constant(settings.blends_depth, [&](auto depth) {
      context.launch("blend", blend_by_pixel_kernel<rule(), depth()>,
                     pixel_order_blocks(pass.tile_count()), kPixelOrderThreads, tile_lists(pass),
                     pass.ray_depths.data(), pass.scratch<CudaScratch>().order(),
                     Background(settings), Pictures(pass));
    });
  });
}

}  // namespace gs::cuda
