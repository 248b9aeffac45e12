// SPDX-License-Identifier: Apache-2.0
// The recipe "a density strategy" of docs/extending.md.
#include <gtest/gtest.h>

#include "tests/support/models.h"

// [recipe]
#include "gs_train/density/density_control.h"

namespace gs {
namespace {

class ThinningControl final : public DensityControl {
 public:
  ThinningControl(const Config& config, const Schedule& schedule)
      : DensityControl(config.density.max_gaussians), schedule_(schedule),
        prune_opacity_(config.density.prune_opacity) {}

  DensityStep of_step(int) const override { return {}; }

  RefineReport after_step(TrainingModel& model, Backend& backend, int step) override {
    RefineReport report;
    if (schedule_.refine(step)) report.pruned = backend.rows().prune(model, prune_opacity_);
    return report;
  }

 private:
  const Schedule schedule_;
  const float prune_opacity_;
};

}  // namespace

std::unique_ptr<DensityControl> make_thinning_control(const Config& config,
                                                      const Schedule& schedule, float) {
  return std::make_unique<ThinningControl>(config, schedule);
}

}  // namespace gs
// [end]

namespace gs {
namespace {

TEST(RecipeDensityStrategy, RemovesFaintGaussiansAndAddsNone) {
  Gaussians gaussians(10, host_memory());
  for (std::size_t i = 0; i < 10; ++i)
    set_gaussian(gaussians, i, {float(i), 0, 0}, 0.1f, i < 4 ? 0.001f : 0.5f);
  TrainingModel model = model_of(gaussians);
  Config config;
  config.train.iterations = 30000;
  MakeDensityControl& make = make_thinning_control;  // the type that kStrategies expects
  const auto control = make(config, Schedule(config, 2), 2);
  const auto backend = make_scalar_backend();
  EXPECT_EQ(control->after_step(model, *backend, 601).pruned, 0u);
  EXPECT_EQ(control->after_step(model, *backend, 600).pruned, 4u);
  EXPECT_EQ(model.count(), 6u);
}

}  // namespace
}  // namespace gs
