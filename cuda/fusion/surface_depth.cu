// SPDX-License-Identifier: Apache-2.0
// The depth of each pixel's surface, twin of gs_render/fusion/surface_depth.cpp, which has the
// equation. subtile.cuh describes the work of a warp.
#include "cuda/fusion/surface_depth.cuh"

#include "cuda/render/blend/subtile.cuh"
#include "gs_render/fusion/surface_depth.h"

namespace gs::cuda {
namespace {

constexpr int kThreads = 256;  // rows are independent: any size that fills the GPU

__global__ void planes_kernel(GaussiansSpan gaussians, Camera camera, const Splat* splats,
                              const std::uint32_t* tile_counts, Span<SplatPlane<float>> planes) {
  const std::size_t i = std::size_t(blockIdx.x) * kThreads + threadIdx.x;
  if (i < planes.size && tile_counts[i] > 0)
    planes[i] = plane_of(gaussians, i, camera, splats[i].conic);
}

struct WarpShared {
  ListedSplat list[kWarp];
  SplatPlane<float> planes[kWarp];  // of the list
  ListWalk::Ahead ahead;
};

/// One lane's pixel.
struct Pixel {
  float x, y;
  std::uint32_t last = 0;  // 1 + position of its last fragment
};

/// The whole warp: calls visit(inverse depth, weight, light left behind it) for the fragments of
/// each lane's pixel, front to back, until is_done() holds in all lanes. Returns the light that is
/// left of this lane's pixel.
template <BlendRule rule, class Visit, class Done>
__device__ float walk(WarpShared& shared, const TileLists& lists, const Subtile& subtile,
                      const SplatPlane<float>* planes, const Pixel& pixel, std::uint32_t longest,
                      const Visit& visit, const Done& is_done) {
  const int lane = lane_of_thread();
  float light = 1;
  for (ListWalk list(shared.ahead, lists, subtile.tile, subtile.pixels(), 0, longest, false);
       !list.is_done() && !__all_sync(kAllLanes, is_done());) {
    const int count = list.list_next(shared.list);
    if (lane < count) shared.planes[lane] = planes[shared.list[lane].gaussian];
    __syncwarp();
    for (int i = 0; i < count; ++i) {
      const ListedSplat& splat = shared.list[i];
      const float dx = pixel.x - splat.mean2d.x, dy = pixel.y - splat.mean2d.y;
      const float e = base2_exponent(splat, dx, dy);
      if (!(e >= splat.lowest && splat.position < pixel.last)) continue;
      const float weight = light * fragment_alpha<rule>(splat.opacity, exp2_fragment(e));
      light -= weight;
      visit(shared.planes[i].at({dx, dy}), weight, light);
    }
    __syncwarp();
  }
  __pipeline_wait_prior(0);  // what was fetched beyond the end
  __syncwarp();
  return light;
}

template <BlendRule rule>
__global__ void __launch_bounds__(kBlendThreads)
    surface_depth_kernel(TileLists lists, const std::uint32_t* last_instance,
                         const SplatPlane<float>* planes, float* inverse_depth) {
  __shared__ WarpShared shared_of_warps[kBlendWarps];
  WarpShared& shared = shared_of_warps[threadIdx.x / kWarp];
  const WarpWork work;
  const Subtile subtile(lists, work.item, work.subtile);
  Pixel pixel{float(subtile.x) + 0.5f, float(subtile.y) + 0.5f};
  if (subtile.is_inside) pixel.last = last_instance[subtile.pixel(lists)];
  const std::uint32_t longest = warp_max(pixel.last);
  bool has_crossed = pixel.last == 0;  // of pixels without a fragment nothing is asked
  float crossing = kUnknownDepth;
  const float left = walk<rule>(
      shared, lists, subtile, planes, pixel, longest,
      [&](float o, float, float light) {
        if (!has_crossed && light < 0.5f) crossing = o, has_crossed = true;
      },
      [&] { return has_crossed; });
  float sum = 0, weights = 0, end = 1;
  if (__any_sync(kAllLanes, crossing > 0))
    end = walk<rule>(
        shared, lists, subtile, planes, pixel, longest,
        [&](float o, float weight, float light) {
          if (!(fabsf(o - crossing) <= kDepthWindow * crossing)) return;
          const float share = depth_share(weight, light);
          sum += share * o, weights += share;
        },
        [] { return false; });
  if (!subtile.is_inside) return;
  float o = kUnknownDepth;
  if (left > kOpenLight)
    o = kOpenPixel;
  else if (crossing > 0 && end <= kMostLight)
    o = sum / weights;
  inverse_depth[subtile.pixel(lists)] = o;
}

}  // namespace

void find_surface_depth(Context& context, const GaussiansSpan& gaussians, const Camera& camera,
                        const RenderSettings& settings, const RenderPass& pass,
                        Buffer<SplatPlane<float>>& planes, float* inverse_depth) {
  const StageScope scope(context, "surface depth");
  planes.resize_discard(pass.tile_counts.size());
  context.launch("surface depth", planes_kernel, blocks_for(planes.size(), kThreads), kThreads,
                 gaussians, camera, pass.splats.data(), pass.tile_counts.data(), planes.span());
  with_rule(settings.blend_rule, [&](auto rule) {
    context.launch("surface depth", surface_depth_kernel<rule()>, blend_blocks(pass.tile_count()),
                   kBlendThreads, tile_lists(pass), pass.last_instance.data(), planes.data(),
                   inverse_depth);
  });
}

}  // namespace gs::cuda
