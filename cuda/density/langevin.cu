// SPDX-License-Identifier: Apache-2.0
// An addition of the MCMC strategy to stage 8: noise on the means after Adam. (The regularizers'
// gradients are added by the kernels of the update.)
#include "cuda/stages.cuh"
#include "gs_train/row_rules.h"

namespace gs::cuda {
namespace {

constexpr int kThreads = 256;  // rows are independent: any size that fills a multiprocessor

__global__ void position_noise_kernel(GaussiansSpan gaussians, PositionNoise noise, float rate,
                                      const std::uint32_t* halted, Shard shard) {
  const std::size_t i = std::size_t(blockIdx.x) * kThreads + threadIdx.x;
  if (i >= gaussians.mean.size || *halted) return;
  gaussians.mean[i] += position_noise(gaussians, i, noise, rate, shard.row_of_all(i));
}

}  // namespace

void add_position_noise(Context& context, const GaussiansSpan& gaussians,
                        const PositionNoise& noise, float position_rate,
                        const std::uint32_t* halted, const Shard& shard) {
  const StageScope scope(context, "position noise");
  context.launch("position noise", position_noise_kernel, blocks_for(gaussians.mean.size, kThreads),
                 kThreads, gaussians, noise, position_rate, halted, shard);
}

}  // namespace gs::cuda
