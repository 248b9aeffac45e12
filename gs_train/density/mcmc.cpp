// SPDX-License-Identifier: Apache-2.0
// The method "mcmc" treats Gaussians as samples. Noise moves faint ones around, regularizers fade
// the superfluous ones, dead ones are moved onto live ones, and the number grows by a share up to
// the cap.   Kheradmand et al. 2024
#include <algorithm>
#include <cmath>

#include "gs_core/error.h"
#include "gs_train/density/density_control.h"

namespace gs {
namespace {

class McmcControl final : public DensityControl {
 public:
  McmcControl(const Config& config, const Schedule& schedule)
      : DensityControl(config.density.max_gaussians), schedule_(schedule), density_(config.density),
        seed_(config.train.seed), regularizers_(regularizers_of(config)) {
    if (density_.max_gaussians <= 0)
      throw UsageError(
          "density.strategy = \"mcmc\" needs a cap on the number of Gaussians; give it with "
          "--max-gaussians N or --max-gaussians auto");
  }

  DensityStep of_step(int step) const override {
    return {.regularizers = regularizers_,
            .noise = {density_.noise_scale, {seed_, RandomStream::position_noise}, step}};
  }

  RefineReport after_step(TrainingModel& model, Backend& backend, int step) override {
    if (!schedule_.refine(step)) return {};
    return backend.rows().relocate(model, {density_.prune_opacity, grown(model.count()), region()},
                                   seed_, step);
  }

 private:
  std::int64_t grown(std::size_t count) const {
    return std::min(most_gaussians(), std::int64_t(double(count) * (1.0 + density_.growth)));
  }

  const Schedule schedule_;
  const DensityConfig density_;
  const std::uint64_t seed_;
  const Regularizers regularizers_;
};

}  // namespace

std::unique_ptr<DensityControl> make_mcmc_control(const Config& config, const Schedule& schedule,
                                                  float) {
  return std::make_unique<McmcControl>(config, schedule);
}

}  // namespace gs
