// SPDX-License-Identifier: Apache-2.0
#include <limits>

#include "gs_train/density_control.h"

namespace gs {

DensityControl::DensityControl(const Config& config, float scene_extent)
    : rules_{config.density.gradient_threshold, config.density.small_scale * scene_extent,
             config.density.prune_opacity, std::numeric_limits<float>::infinity(),
             config.density.max_gaussians},
      prune_scale_(config.density.prune_scale * scene_extent), random_{
                                                                   config.train.seed,
                                                                   RandomStream::split_gaussians} {}

RefineReport DensityControl::refine(TrainingModel& model, Backend& backend, int step,
                                    bool prune_large) const {
  AdaptiveRules rules = rules_;
  if (prune_large) rules.prune_scale = prune_scale_;
  return backend.rows().refine(model, rules, random_, step);
}

void DensityControl::reset_opacity(TrainingModel& model, Backend& backend) const {
  backend.rows().reset_opacity(model, kResetOpacity);
}

}  // namespace gs
