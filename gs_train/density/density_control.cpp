// SPDX-License-Identifier: Apache-2.0
#include "gs_train/density/density_control.h"

#include <limits>

#include "gs_train/named_row.h"

namespace gs {
namespace {

struct Strategy {
  const char* name;  // a word of density.strategy
  MakeDensityControl* make;
};
constexpr Strategy kStrategies[] = {
    {"adaptive", make_adaptive_control},
    {"budgeted", make_budgeted_control},
    {"mcmc", make_mcmc_control},
};

}  // namespace

std::vector<std::string> density_strategies() { return names_of(kStrategies); }

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

float prune_scale_within(const Config& config, float scene_extent) {
  return config.model.sky == SkyModel::none ? std::numeric_limits<float>::infinity() : scene_extent;
}

std::unique_ptr<DensityControl> make_density_control(const Config& config, const Schedule& schedule,
                                                     float scene_extent) {
  return row_named(kStrategies, config.density.strategy, "density.strategy")
      ->make(config, schedule, scene_extent);
}

}  // namespace gs
