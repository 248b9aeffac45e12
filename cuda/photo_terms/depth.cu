// SPDX-License-Identifier: Apache-2.0
// Stage 5 for photos with a depth map: the gradient of the depth loss by what stage 4 has blended.
// Twin of gs_train/stages/depth_loss.cpp.
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

// The pixels of a step's photo.
struct DepthPixels {
  DepthMapOnDevice map;
  const float *depth, *transmittance;  // (H, W)  of the pass
  int width;
  std::uint32_t count;

  __device__ float value(std::uint32_t i) const {
    return reduced_depth(map.values, map.width, map.reduction, int(i % std::uint32_t(width)),
                         int(i / std::uint32_t(width)));
  }
  __device__ float coverage(std::uint32_t i) const { return 1.0f - transmittance[i]; }
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
      add_to(sums,
             depth_sums_of_pixel(pixels.map.kind, double(value), double(m), double(pixels.depth[i]),
                                 double(pixels.coverage(i)), before));
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
    compare_depth_kernel(DepthPixels pixels, const DepthTarget* target, float* dL_ddepth,
                         float* dL_dalpha) {
  const std::uint32_t i = blockIdx.x * kThreads + threadIdx.x;
  if (i >= pixels.count) return;
  const DepthPixelGradient<float> gradient =
      depth_pixel_vjp(pixels.map.kind, *target, pixels.value(i), pixels.mask(i), pixels.depth[i],
                      pixels.coverage(i));
  dL_ddepth[i] = gradient.Z;
  dL_dalpha[i] = gradient.A;
}

}  // namespace

PictureGradient DepthStage::compare(Context& context, const DepthMapOnDevice& map, float weight,
                                    Span<const float> dL_dimage, const RenderPass& pass) {
  const std::size_t pixel_count = pass.pixel_count();
  dL_ddepth_.resize_discard(pixel_count);
  dL_dalpha_.resize_discard(pixel_count);
  sums_.resize_discard(kSumBlocks);
  target_.resize_discard(1);
  const DepthPixels pixels{map, pass.depth_image.data(), pass.transmittance.data(), pass.width,
                           std::uint32_t(pixel_count)};
  const StageScope scope(context, "depth");
  for (int round = 0; round < depth_fit_rounds(map.kind); ++round) {
    const DepthTarget* const before = round > 0 ? target_.data() : nullptr;
    context.launch("depth sums", sum_depths_kernel, kSumBlocks, kThreads, pixels, before,
                   sums_.data());
    context.launch("depth fit", find_target_kernel, 1, kThreads, sums_.data(), kSumBlocks, map.kind,
                   double(weight), target_.data());
  }
  context.launch("depth loss", compare_depth_kernel, blocks_for(pixel_count, kThreads), kThreads,
                 pixels, target_.data(), dL_ddepth_.data(), dL_dalpha_.data());
  return {dL_dimage, dL_dalpha_.span(), dL_ddepth_.span()};
}

void DepthStage::release() {
  for (Buffer<float>* const pixels : {&dL_ddepth_, &dL_dalpha_}) pixels->release();
}

}  // namespace gs::cuda
