// SPDX-License-Identifier: Apache-2.0
// Additions of the MCMC strategy to stage 8: the regularizers' gradients before Adam, where
// gradients are stored, and noise on the means after Adam. The fused update of
// preprocess_backward.cu adds the regularizers' gradients itself.
#include "cuda/stages.cuh"
#include "gs_train/row_rules.h"

namespace gs::cuda {
namespace {

constexpr int kThreads = 256;  // rows are independent: any size that fills a multiprocessor

__global__ void regularizer_kernel(GaussiansSpan gaussians, Regularizers of_each,
                                   GaussiansSpan gradients) {
  const std::size_t i = std::size_t(blockIdx.x) * kThreads + threadIdx.x;
  if (i >= gaussians.mean.size) return;
  const RegularizerGradient<float> gradient =
      regularizer_vjp(gaussians.log_scale[i], gaussians.logit_opacity[i], of_each);
  gradients.log_scale[i] += gradient.log_scale;
  gradients.logit_opacity[i] += gradient.logit_opacity;
  if (gaussians.has_time) add_spacetime_regularizer_gradients(gaussians, i, of_each, gradients);
}

__global__ void position_noise_kernel(GaussiansSpan gaussians, PositionNoise noise, float rate,
                                      const std::uint32_t* halted, Shard shard) {
  const std::size_t i = std::size_t(blockIdx.x) * kThreads + threadIdx.x;
  if (i >= gaussians.mean.size || (halted && *halted)) return;
  gaussians.mean[i] += position_noise(gaussians, i, noise, rate, shard.row_of_all(i));
}

}  // namespace

void add_regularizer_gradients(Context& context, const GaussiansSpan& gaussians,
                               const Regularizers& regularizers, const GaussiansSpan& gradients) {
  const StageScope scope(context, "regularizers");
  const std::size_t count = gaussians.mean.size;
  context.launch("regularizers", regularizer_kernel, blocks_for(count, kThreads), kThreads,
                 gaussians, regularizers.of_each(count), gradients);
}

void add_position_noise(Context& context, const GaussiansSpan& gaussians,
                        const PositionNoise& noise, float position_rate,
                        const std::uint32_t* halted, const Shard& shard) {
  const StageScope scope(context, "position noise");
  context.launch("position noise", position_noise_kernel, blocks_for(gaussians.mean.size, kThreads),
                 kThreads, gaussians, noise, position_rate, halted, shard);
}

}  // namespace gs::cuda
