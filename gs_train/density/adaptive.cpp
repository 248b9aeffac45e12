// SPDX-License-Identifier: Apache-2.0
// The strategy "adaptive": clones, splits, prunes and opacity resets.   Kerbl et al. 2023, Sec. 5.2
#include <limits>

#include "gs_train/density/density_control.h"

namespace gs {
namespace {

class AdaptiveControl final : public DensityControl {
 public:
  AdaptiveControl(const Config& config, const Schedule& schedule, float scene_extent)
      : DensityControl(config.density.max_gaussians),
        schedule_(schedule), rules_{config.density.gradient_threshold,
                                    config.density.small_scale * scene_extent,
                                    config.density.prune_opacity,
                                    std::numeric_limits<float>::infinity(),
                                    0,
                                    prune_scale_within(config, scene_extent)},
        prune_scale_(prune_scale_of(config, scene_extent)), random_{config.train.seed,
                                                                    RandomStream::split_gaussians},
        regularizers_(regularizers_of(config)) {}

  DensityStep of_step(int step) const override {
    return {.gather_statistics = schedule_.gather_statistics(step), .regularizers = regularizers_};
  }

  RefineReport after_step(TrainingModel& model, Backend& backend, int step) override {
    RefineReport report;
    if (schedule_.refine(step)) {
      AdaptiveRules rules = rules_;
      rules.max_gaussians = most_gaussians();
      rules.region = region();
      if (schedule_.prune_large(step)) rules.prune_scale = prune_scale_;
      report = backend.rows().refine(model, rules, random_, step);
    }
    if (schedule_.reset_opacity(step)) backend.rows().reset_opacity(model, kResetOpacity);
    return report;
  }

 private:
  const Schedule schedule_;
  const AdaptiveRules rules_;
  const float prune_scale_;  // world units
  const Random random_;
  const Regularizers regularizers_;
};

}  // namespace

std::unique_ptr<DensityControl> make_adaptive_control(const Config& config,
                                                      const Schedule& schedule,
                                                      float scene_extent) {
  return std::make_unique<AdaptiveControl>(config, schedule, scene_extent);
}

}  // namespace gs
