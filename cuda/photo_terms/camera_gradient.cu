// SPDX-License-Identifier: Apache-2.0
// Stage 7 for runs that refine poses: the gradients of all splats pulled back to the camera, and
// added up. Twin of gs_render/stages/camera_gradient.cpp. A thread takes one Gaussian, a block adds
// up its threads' shares, and a single block those of all blocks, which it pulls back to the motion
// of the photo's row. Each sum has an order of its own, so that the same bits come out each time.
#include "cuda/device/block_sums.cuh"
#include "cuda/stages.cuh"
#include "gs_core/math/pose/camera_gradient.h"
#include "gs_train/poses/pose_state.h"

namespace gs::cuda {
namespace {

constexpr int kThreads = 256;  // of both kernels; a multiple of a warp
constexpr int kWarps = kThreads / kWarp;
constexpr int kSums = int(kPoseNumbers);

// What the kernel reads of stages 1 and 6.
struct SplatGradients {
  const std::uint32_t* tile_counts;  // (N)
  const Splat* splats;               // (N)
  const SplatGradientSum* sums;      // (N)
};

template <bool has_lens>
__global__ void __launch_bounds__(kThreads)
    add_gaussians_kernel(GaussiansSpan gaussians, Camera given, const DevicePose* pose,
                         SplatSettings settings, SplatGradients in, double* of_blocks,
                         Shard shard) {
  const Camera camera = refined<has_lens>(given, pose);
  __shared__ double of_warps[kWarps][kSums];
  const std::size_t first = std::size_t(blockIdx.x) * kThreads, i = first + threadIdx.x;
  const std::size_t to = shard.row_of_all(first), projected = to + threadIdx.x;
  double sums[kSums] = {0, 0, 0, 0, 0, 0};
  if (i < gaussians.mean.size && in.tile_counts[projected] > 0) {
    const SplatGradient dL_dsplat =
        masked(load_in_vectors(in.sums + projected), in.splats[projected].color);
    const CameraGradient<float> dL = camera_vjp(gaussians, i, camera, settings, dL_dsplat);
    for (int k = 0; k < 3; ++k) sums[k] = double(dL.turn[k]), sums[3 + k] = double(dL.center[k]);
  }
  sum_of_block(sums, of_warps, of_blocks + kSums * (to / kThreads));
}

// Thread t takes the blocks t, t + kThreads, ...
__global__ void __launch_bounds__(kThreads)
    add_blocks_kernel(const double* of_blocks, std::size_t blocks, PoseRow row, double weight) {
  __shared__ double of_warps[kWarps][kSums], n[kSums];
  double sums[kSums] = {0, 0, 0, 0, 0, 0};
  for (std::size_t block = threadIdx.x; block < blocks; block += kThreads)
    for (int k = 0; k < kSums; ++k) sums[k] += of_blocks[kSums * block + k];
  sum_of_block(sums, of_warps, n);
  __syncthreads();
  if (threadIdx.x != 0) return;
  const RigidMotion<double> by_motion = moved_vjp(
      row.given, row.frame, row.motion(), {Vec3d(n[0], n[1], n[2]), Vec3d(n[3], n[4], n[5])});
  for (int k = 0; k < 3; ++k) {
    row.gradient[k] += weight * by_motion.turn[k];
    row.gradient[3 + k] += weight * row.extent * by_motion.shift[k];
  }
}

}  // namespace

std::size_t camera_blocks(std::size_t rows) { return blocks_for(rows, kThreads); }

void add_camera_blocks(Context& context, const GaussiansSpan& gaussians, const PhotoRows& photo,
                       double* of_blocks, const Shard& shard) {
  const StageScope scope(context, "camera gradient");
  GS_CHECK(shard.gpus == 1 || shard.chunk_rows() % kThreads == 0);
  const SplatGradients in{photo.tile_counts, photo.splats, photo.gradients};
  const SplatSettings& settings = photo.settings;
  const auto launch = [&](auto kernel) {
    context.launch("camera gradient", kernel, camera_blocks(gaussians.mean.size), kThreads,
                   gaussians, photo.camera, photo.pose, settings, in, of_blocks, shard);
  };
  photo.camera.has_lens() ? launch(add_gaussians_kernel<true>)
                          : launch(add_gaussians_kernel<false>);
}

void camera_gradient(Context& context, const double* of_blocks, std::size_t blocks,
                     const PoseRow& row, double weight) {
  const StageScope scope(context, "camera gradient");
  context.launch("camera gradient", add_blocks_kernel, 1, kThreads, of_blocks, blocks, row, weight);
}

}  // namespace gs::cuda
