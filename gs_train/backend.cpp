// SPDX-License-Identifier: Apache-2.0
#include "gs_train/backend.h"

namespace gs {

void Backend::step(TrainingModel& model, const View& view, const RenderSettings& settings,
                   const LossSettings& loss_settings, const LearningRates& rates,
                   const DensityStep& density) {
  gradients_.has_time = model.gaussians.has_time;
  gradients_.resize(model.count());
  dL_dmean2d_.resize(model.count());
  const GaussiansSpan gaussians = model.gaussians.span();

  renderer().forward(gaussians, view.camera, settings, pass_);
  loss().forward_backward(pass_, *with_photo(view), loss_settings, dL_dimage_);
  renderer().backward(gaussians, view.camera, settings, pass_, dL_dimage_.span(), gradients_.span(),
                      dL_dmean2d_.span());
  if (density.regularizers.any()) optimizer().regularize(model, density.regularizers, gradients_);
  optimizer().step(model, gradients_, rates);
  if (density.noise.scale > 0) optimizer().add_noise(model, density.noise, rates.mean);
  if (density.gather_statistics) gather(model, pass_, dL_dmean2d_.span());
}

void Backend::release_caches() {
  release_pass();
  rows().release_caches();
}

void Backend::release_pass() {
  pass_ = RenderPass(pass_.image.memory());
  dL_dimage_.release();
  dL_dmean2d_.release();
  gradients_ = Gaussians(gradients_.memory());
}

}  // namespace gs
