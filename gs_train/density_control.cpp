// SPDX-License-Identifier: Apache-2.0
#include "gs_train/density_control.h"

#include <algorithm>
#include <limits>

namespace gs {

DensityControl::DensityControl(const Config& config, float scene_extent)
    : rules_{config.density.gradient_threshold, config.density.small_scale * scene_extent,
             config.density.prune_opacity, std::numeric_limits<float>::infinity(),
             config.density.max_gaussians},
      prune_scale_(config.density.prune_scale * scene_extent),
      config_cap_(config.density.max_gaussians), random_{config.train.seed,
                                                         RandomStream::split_gaussians} {}

void DensityControl::set_growth_cap(std::int64_t most) {
  growth_cap_ = most;
  rules_.max_gaussians =
      config_cap_ > 0 && most > 0 ? std::min(config_cap_, most) : std::max(config_cap_, most);
}

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
