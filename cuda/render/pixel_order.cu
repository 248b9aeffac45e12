// SPDX-License-Identifier: Apache-2.0
// What the order by pixel adds before blending: after stage 1 how far along the rays each Gaussian
// is, and after stage 2 keys by which lists are sorted by the depth at each splat's best point of
// the tile.   Radl et al. 2024 (StopThePop)
#include "cuda/render/blend/subtile.cuh"
#include "cuda/render/instance_buffer.cuh"
#include "gs_core/math/render/depth_key.h"

namespace gs::cuda {
namespace {

constexpr int kThreads = 256;

__global__ void __launch_bounds__(kThreads)
    ray_depths_kernel(GaussiansSpan gaussians, Camera given, const DevicePose* pose,
                      const std::uint32_t* tile_counts, RayDepth<float>* to) {
  const std::size_t i = std::size_t(blockIdx.x) * kThreads + threadIdx.x;
  if (i >= gaussians.mean.size || tile_counts[i] == 0) return;
  const float filter_scale = gaussians.has_filter ? gaussians.filter_scale[i] : 0.0f;
  to[i] = ray_depth(refined<false>(given, pose),
                    {gaussians.mean[i], gaussians.log_scale[i], gaussians.rotation[i],
                     gaussians.logit_opacity[i], gaussians.sh0[i], nullptr, filter_scale});
}

// The upper bits of a key are the tile's, the lower ones the depth's.
struct KeyLayout {
  int depth_bits;
  DepthKeys depths;
  float near_plane, far_plane;

  // A depth of at most 0 has the most of its Gaussian behind the eye: it comes last.
  __device__ std::uint32_t key(std::uint32_t tile, float depth) const {
    const float clamped = depth > near_plane ? fminf(depth, far_plane)
                          : depth > 0.0f     ? near_plane
                                             : far_plane;
    return tile << depth_bits | depth_key(depths, clamped) >> (kDepthKeyBits - depth_bits);
  }
};

__global__ void __launch_bounds__(kThreads)
    pixel_order_keys_kernel(TileLists lists, const RayDepth<float>* rays, KeyLayout layout,
                            std::uint32_t tiles, const std::uint32_t* instances,
                            std::uint32_t capacity, std::uint32_t* keys) {
  const std::uint32_t place = blockIdx.x * kThreads + threadIdx.x;
  if (place >= capacity) return;
  const std::uint32_t tile = keys[place];
  if (tile >= tiles) {  // a place that is not in use
    keys[place] = tile << layout.depth_bits;
    return;
  }
  const std::uint32_t gaussian = gaussian_of(instances[place]);
  const Splat& splat = lists.of_gaussian[gaussian];
  const float x = float(tile % lists.tiles_x * kTileWidth) + 0.5f,
              y = float(tile / lists.tiles_x * kTileHeight) + 0.5f;
  const Vec2f d = least_in_rectangle(splat.mean2d, splat.conic, x, x + float(kTileWidth - 1), y,
                                     y + float(kTileHeight - 1))
                      .offset;
  keys[place] = layout.key(tile, rays[gaussian].at(d.x, d.y));
}

}  // namespace

void find_ray_depths(Context& context, const GaussiansSpan& gaussians, const Camera& camera,
                     const DevicePose* pose, RenderPass& pass) {
  check_has_rays(gaussians, camera);
  const StageScope scope(context, "ray depths");
  pass.ray_depths.resize_discard(gaussians.mean.size);
  context.launch("ray depths", ray_depths_kernel, blocks_for(gaussians.mean.size, kThreads),
                 kThreads, gaussians, camera, pose, pass.tile_counts.data(),
                 pass.ray_depths.data());
}

void add_depths_to_keys(Context& context, const RenderSettings& settings, Workspace& workspace,
                        RenderPass& pass, std::uint32_t capacity) {
  const StageScope scope(context, "instances");
  const auto instances =
      unsorted_instances<std::uint32_t>(instance_buffer(settings, workspace, pass), pass, capacity);
  const KeyLayout layout{depth_bits(pass), depth_keys(settings.near_plane, settings.far_plane),
                         settings.near_plane, settings.far_plane};
  context.launch("keys of instances", pixel_order_keys_kernel, blocks_for(capacity, kThreads),
                 kThreads, tile_lists(pass), pass.ray_depths.data(), layout,
                 std::uint32_t(pass.tile_count()), instances.splats, capacity, instances.keys);
}

}  // namespace gs::cuda
