// SPDX-License-Identifier: Apache-2.0
// Stage 4 of the order by pixel: blends the fragments of each pixel in the order of their depths
// along its ray. pixel_order.cuh describes the work of a warp.   Radl et al. 2024 (StopThePop)
#include "cuda/render/blend/pixel_order.cuh"

namespace gs::cuda {
namespace {

struct Output {
  float* image;            // (3, H, W)
  float* transmittance;    // (H, W)
  std::uint32_t* blended;  // (H, W)
  float* depth;            // (H, W)
};

template <BlendRule rule, bool with_depth>
__global__ void __launch_bounds__(kPixelOrderThreads)
    blend_by_pixel_kernel(TileLists lists, const RayDepth<float>* rays,
                          const std::uint32_t* tile_order, Background background, Output out) {
  using Walk = PixelOrderWalk<with_depth>;
  __shared__ typename Walk::Shared shared;
  __shared__ float alphas[kPlaces][kWarp];
  const std::uint32_t item = blockIdx.x / kSubtilesPerTile;
  const Subtile subtile(lists, tile_of(tile_order, item), int(blockIdx.x % kSubtilesPerTile));
  if (subtile.x0 >= lists.width || subtile.y0 >= lists.height) return;  // the whole warp
  const int lane = lane_of_thread();
  PixelState<float> pixel;
  bool is_open = subtile.is_inside;  // takes further fragments
  std::uint32_t blended = 0;
  float depth = 0;
  Walk walk(shared, lists, rays, subtile);
  do {
    walk.template take<rule>(
        is_open, [&](int place, float alpha) { alphas[place][lane] = alpha; },
        [&](int place, const typename Walk::Listed& splat) {
          const float alpha = alphas[place][lane];
          if (rule == BlendRule::classic && is_opaque(pixel.transmittance * (1.0f - alpha)))
            is_open = false;
          if (!is_open) return;
          if constexpr (with_depth) depth = fmaf(pixel.transmittance * alpha, splat.depth, depth);
          composite(pixel, {splat.red, splat.green, splat.blue}, alpha);
          ++blended;
          if (rule == BlendRule::faster_gs && is_opaque(pixel.transmittance)) is_open = false;
        });
  } while (!walk.is_done() && __any_sync(kAllLanes, is_open));
  if (!subtile.is_inside) return;
  const std::size_t to = subtile.pixel(lists), plane = std::size_t(lists.width) * lists.height;
  const Vec3f color = pixel.color + pixel.transmittance * background();
  out.image[to] = color.x;
  out.image[plane + to] = color.y;
  out.image[2 * plane + to] = color.z;
  out.transmittance[to] = pixel.transmittance;
  out.blended[to] = blended;
  if constexpr (with_depth) out.depth[to] = depth;
}

}  // namespace

void blend_by_pixel(Context& context, const RenderSettings& settings, RenderPass& pass) {
  const Output out{pass.image.data(), pass.transmittance.data(), pass.last_instance.data(),
                   pass.depth_image.data()};
  with_rule(settings.blend_rule, [&](auto rule) {
    with_constant(settings.blends_depth, [&](auto depth) {
      context.launch("blend", blend_by_pixel_kernel<rule(), depth()>,
                     pixel_order_blocks(pass.tile_count()), kPixelOrderThreads, tile_lists(pass),
                     pass.ray_depths.data(), pass.scratch<CudaScratch>().order(),
                     Background(settings), out);
    });
  });
}

}  // namespace gs::cuda
