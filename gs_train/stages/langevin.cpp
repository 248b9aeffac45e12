// SPDX-License-Identifier: Apache-2.0
// The MCMC strategy's additions to stage 8: gradients of the regularizers before Adam, noise on the
// means after it.
#include "gs_core/threads/parallel.h"
#include "gs_render/stage_clock.h"
#include "gs_train/row_rules.h"
#include "gs_train/stages/scalar_stages.h"

namespace gs {

void regularize(const TrainingModel& model, const Regularizers& regularizers,
                Gaussians& gradients) {
  const HostStage stage("regularizers");
  const GaussiansSpan gaussians = model.gaussians.span(), to = gradients.span();
  const Regularizers of_each = regularizers.of_each(model.count());
  parallel_for(model.count(), 4096, [&](std::size_t i) {
    const RegularizerGradient<float> gradient =
        regularizer_vjp(gaussians.log_scale[i], gaussians.logit_opacity[i], of_each);
    to.log_scale[i] += gradient.log_scale;
    to.logit_opacity[i] += gradient.logit_opacity;
    if (gaussians.has_time) add_spacetime_regularizer_gradients(gaussians, i, of_each, to);
  });
}

void add_noise(TrainingModel& model, const PositionNoise& noise, float position_rate) {
  const HostStage stage("position noise");
  const GaussiansSpan gaussians = model.gaussians.span();
  parallel_for(model.count(), 4096, [&](std::size_t i) {
    gaussians.mean[i] += position_noise(gaussians, i, noise, position_rate);
  });
}

}  // namespace gs
