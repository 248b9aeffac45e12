// SPDX-License-Identifier: Apache-2.0
#include "gs_train/density/density_control.h"

#include <limits>

namespace gs {

Regularizers regularizers_of(const Config& config) {
  const DensityConfig& density = config.density;
  Regularizers weights{density.opacity_regularizer, density.scale_regularizer};
  if (!config.model.dynamic) return weights;
  weights.time_scale = density.time_scale_regularizer;
  weights.velocity = density.velocity_regularizer;
  return weights;
}

float prune_scale_of(const Config& config, float scene_extent) {
  const float share = config.density.prune_scale;
  return share > 0 ? share * scene_extent : std::numeric_limits<float>::infinity();
}

std::unique_ptr<DensityControl> make_density_control(const Config& config, const Schedule& schedule,
                                                     float scene_extent) {
  const GrowthMethod& method = growth_method(config.density.strategy);
  return method.relocates ? make_mcmc_control(config, schedule, scene_extent)
                          : make_growth_control(config, method, schedule, scene_extent);
}

}  // namespace gs
