// SPDX-License-Identifier: Apache-2.0
// Stages 4 to 6 for photos with a depth map. Twin of gs_render/stages/blend_depth.cpp and
// gs_train/stages/depth_loss.cpp.
//
// The blend kernels know nothing of depth: between two of their launches, the splats have (z, 1, 0)
// for a color, and the gradients of the colors wait in a buffer of their own.
#include "cuda/photo_terms/depth.cuh"

#include "cuda/device/warp.cuh"
#include "cuda/stages.cuh"
#include "gs_core/image.h"
#include "gs_core/math/loss/area_filter.h"

namespace gs::cuda {
namespace {

constexpr int kThreads = 256;  // of all kernels; a multiple of a warp
constexpr int kWarps = kThreads / kWarp;
constexpr int kSumBlocks = 256;  // of the sums of a photo: some per multiprocessor

// The splats of a pass, and what is set aside.
struct DepthRows {
  std::size_t count;
  const std::uint32_t* tile_counts;  // (N)
  const float* depths;               // (N)
  Splat* splats;                     // (N)
  SplatGradientSum* sums;            // (N)
  Vec3f *colors, *gradients;         // (N)
};

__global__ void __launch_bounds__(kThreads) take_depths_kernel(DepthRows rows) {
  const std::size_t i = std::size_t(blockIdx.x) * kThreads + threadIdx.x;
  if (i >= rows.count || rows.tile_counts[i] == 0) return;
  SplatGradientSum& sum = rows.sums[i];
  rows.colors[i] = rows.splats[i].color;
  rows.gradients[i] = {sum.red, sum.green, sum.blue};
  rows.splats[i].color = {rows.depths[i], 1.0f, 0.0f};
  sum.red = sum.green = sum.blue = 0.0f;
}

// The gradient by the depth is that by the first "channel".
__global__ void __launch_bounds__(kThreads) return_colors_kernel(DepthRows rows) {
  const std::size_t i = std::size_t(blockIdx.x) * kThreads + threadIdx.x;
  if (i >= rows.count || rows.tile_counts[i] == 0) return;
  SplatGradientSum& sum = rows.sums[i];
  sum.depth = sum.red;
  sum.red = rows.gradients[i].x;
  sum.green = rows.gradients[i].y;
  sum.blue = rows.gradients[i].z;
  rows.splats[i].color = rows.colors[i];
}

// The pixels of a step's photo.
struct DepthPixels {
  DepthMapOnDevice map;
  const float* planes;  // (3, H, W)
  int width;
  std::uint32_t count;

  __device__ float value(std::uint32_t i) const {
    return reduced_depth(map.values, map.width, map.reduction, int(i % std::uint32_t(width)),
                         int(i / std::uint32_t(width)));
  }
  __device__ float mask(std::uint32_t i) const {
    return map.mask ? float(map.mask[i]) * kPerByte : 1.0f;
  }
};

/// All threads of a block: adds up their sums, in an order of its own. The result is that of thread
/// 0.
__device__ DepthSums add_up(const DepthSums& of_thread, double (&of_warps)[kWarps][kDepthSums]) {
  const double* const numbers = reinterpret_cast<const double*>(&of_thread);
  for (int k = 0; k < kDepthSums; ++k) {
    const double of_warp = warp_sum(numbers[k]);
    if (lane_of_thread() == 0) of_warps[threadIdx.x / kWarp][k] = of_warp;
  }
  __syncthreads();
  DepthSums all;
  double* const sums = reinterpret_cast<double*>(&all);
  if (threadIdx.x == 0)
    for (int warp = 0; warp < kWarps; ++warp)
      for (int k = 0; k < kDepthSums; ++k) sums[k] += of_warps[warp][k];
  return all;
}

__global__ void __launch_bounds__(kThreads)
    sum_depths_kernel(DepthPixels pixels, const DepthTarget* before, DepthSums* to) {
  __shared__ double of_warps[kWarps][kDepthSums];
  DepthSums sums;
  for (std::uint32_t i = blockIdx.x * kThreads + threadIdx.x; i < pixels.count;
       i += gridDim.x * kThreads) {
    const float value = pixels.value(i), m = pixels.mask(i);
    if (is_known_depth(value) && m > 0)
      add_to(sums, depth_sums_of_pixel(pixels.map.kind, double(value), double(m),
                                       double(pixels.planes[i]),
                                       double(pixels.planes[pixels.count + i]), before));
  }
  const DepthSums all = add_up(sums, of_warps);
  if (threadIdx.x == 0) to[blockIdx.x] = all;
}

// One block; thread t takes the blocks t, t + kThreads, ...
__global__ void __launch_bounds__(kThreads)
    find_target_kernel(const DepthSums* of_blocks, int blocks, DepthKind kind, double weight,
                       DepthTarget* target) {
  __shared__ double of_warps[kWarps][kDepthSums];
  DepthSums sums;
  for (int block = int(threadIdx.x); block < blocks; block += kThreads)
    add_to(sums, of_blocks[block]);
  const DepthSums all = add_up(sums, of_warps);
  if (threadIdx.x == 0) *target = depth_target(kind, all, weight);
}

__global__ void __launch_bounds__(kThreads)
    compare_depth_kernel(DepthPixels pixels, const DepthTarget* target, float* dL_dplanes) {
  const std::uint32_t i = blockIdx.x * kThreads + threadIdx.x;
  if (i >= pixels.count) return;
  const DepthPixelGradient<float> gradient =
      depth_pixel_vjp(pixels.map.kind, *target, pixels.value(i), pixels.mask(i), pixels.planes[i],
                      pixels.planes[pixels.count + i]);
  dL_dplanes[i] = gradient.Z;
  dL_dplanes[pixels.count + i] = gradient.A;
  dL_dplanes[2 * pixels.count + i] = 0.0f;
}

// Tensor cores round colors to 11 bits.
RenderSettings depth_settings(RenderSettings settings) {
  settings.background = Vec3f(0);
  settings.fragment_statistic = FragmentStatistic::none;
  settings.use_tensor_cores = false;
  return settings;
}

}  // namespace

const DepthMaps::Map& DepthMaps::of(const View& view) {
  const auto known = maps_.find(&view);
  if (known != maps_.end()) return known->second;
  const std::shared_ptr<const View> loaded = with_photo(view);
  Map map{Buffer<float>(memory_), loaded->depth_kind};
  map.values.upload(loaded->depth.pixels);
  return maps_.emplace(&view, std::move(map)).first->second;
}

void DepthStage::add_gradient(Context& context, const RenderSettings& settings,
                              const DepthMapOnDevice& map, float weight, Workspace& workspace,
                              RenderPass& pass) {
  const std::size_t count = pass.tile_counts.size(), plane = pass.pixel_count();
  const RenderSettings of_depth = depth_settings(settings);
  colors_.resize_discard(count);
  color_gradients_.resize_discard(count);
  dL_dplanes_.resize_discard(3 * plane);
  sums_.resize_discard(kSumBlocks);
  target_.resize_discard(1);
  const DepthRows rows{count,
                       pass.tile_counts.data(),
                       pass.depths.data(),
                       pass.splats.data(),
                       workspace.splat_gradients.data(),
                       colors_.data(),
                       color_gradients_.data()};
  {
    const StageScope scope(context, "depth");
    context.launch("depth colors", take_depths_kernel, blocks_for(count, kThreads), kThreads, rows);
  }
  pass.image.swap(planes_);
  blend(context, of_depth, pass);
  const DepthPixels pixels{map, pass.image.data(), pass.width, std::uint32_t(plane)};
  {
    const StageScope scope(context, "depth");
    for (int round = 0; round < depth_fit_rounds(map.kind); ++round) {
      const DepthTarget* const before = round > 0 ? target_.data() : nullptr;
      context.launch("depth sums", sum_depths_kernel, kSumBlocks, kThreads, pixels, before,
                     sums_.data());
      context.launch("depth fit", find_target_kernel, 1, kThreads, sums_.data(), kSumBlocks,
                     map.kind, double(weight), target_.data());
    }
    context.launch("depth loss", compare_depth_kernel, blocks_for(plane, kThreads), kThreads,
                   pixels, target_.data(), dL_dplanes_.data());
  }
  blend_backward(context, of_depth, {dL_dplanes_.span(), {}, {}}, workspace, pass);
  const StageScope scope(context, "depth");
  context.launch("depth gradients", return_colors_kernel, blocks_for(count, kThreads), kThreads,
                 rows);
  pass.image.swap(planes_);
}

void DepthStage::release() {
  for (Buffer<Vec3f>* const rows : {&colors_, &color_gradients_}) rows->release();
  for (Buffer<float>* const planes : {&planes_, &dL_dplanes_}) planes->release();
}

}  // namespace gs::cuda
