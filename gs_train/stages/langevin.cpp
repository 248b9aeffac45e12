// SPDX-License-Identifier: Apache-2.0
// The MCMC strategy's additions to stage 8: gradients of the regularizers before Adam, noise on the
// means after it.
#include "gs_core/threads/parallel.h"
#include "gs_train/row_rules.h"
#include "gs_train/stages/scalar_stages.h"

namespace gs {

void add_regularizer_gradients(const GaussiansSpan& gaussians, const Regularizers& of_each,
                               const GaussiansSpan& gradients) {
  parallel_for(gaussians.mean.size, 4096, [&](std::size_t i) {
    const RegularizerGradient<float> gradient =
        regularizer_vjp(gaussians.log_scale[i], gaussians.logit_opacity[i], of_each);
    gradients.log_scale[i] += gradient.log_scale;
    gradients.logit_opacity[i] += gradient.logit_opacity;
    if (gaussians.has_time) add_spacetime_regularizer_gradients(gaussians, i, of_each, gradients);
  });
}

void add_position_noise(const GaussiansSpan& gaussians, const PositionNoise& noise,
                        float position_rate) {
  parallel_for(gaussians.mean.size, 4096, [&](std::size_t i) {
    gaussians.mean[i] += position_noise(gaussians, i, noise, position_rate);
  });
}

}  // namespace gs
