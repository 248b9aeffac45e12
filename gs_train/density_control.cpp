// SPDX-License-Identifier: Apache-2.0
#include "gs_train/density_control.h"

#include "gs_core/error.h"

namespace gs {
namespace {

struct Strategy {
  const char* name;  // as density.strategy has it
  MakeDensityControl* make;
};
constexpr Strategy kStrategies[] = {
    {"adaptive", make_adaptive_control},
    {"mcmc", make_mcmc_control},
};

}  // namespace

std::vector<std::string> density_strategies() {
  std::vector<std::string> names;
  for (const Strategy& strategy : kStrategies) names.push_back(strategy.name);
  return names;
}

std::unique_ptr<DensityControl> make_density_control(const Config& config, const Schedule& schedule,
                                                     float scene_extent) {
  std::string known;
  for (const Strategy& strategy : kStrategies) {
    if (config.density.strategy == strategy.name)
      return strategy.make(config, schedule, scene_extent);
    known += (known.empty() ? "" : ", ") + std::string(strategy.name);
  }
  throw UsageError("there is no density.strategy " + config.density.strategy + "; it is one of " +
                   known);
}

}  // namespace gs
