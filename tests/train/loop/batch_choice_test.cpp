// SPDX-License-Identifier: Apache-2.0
// Which batches the CUDA backend does together (cuda/train/batch_choice.h). Both ways have the same
// result, so that no other test notices where a run takes the slower one.
#include "cuda/train/batch_choice.h"

#include <gtest/gtest.h>

#include <functional>

#include "gs_core/config/config.h"
#include "gs_core/density/growth_method.h"

namespace gs::cuda {
namespace {

// A step of the defaults.
struct Step {
  View view;
  TrainingModel model;
  std::vector<TrainingPhoto> batch;
  LossSettings loss_settings;
  DensityStep density{.gather_statistics = true};

  explicit Step(std::size_t photos) {
    const Config defaults;
    loss_settings.depth_weight = defaults.loss.depth_weight;
    density.score = growth_method(defaults.density.strategy).score;
    for (std::size_t i = 0; i < photos; ++i) batch.push_back({&view, RenderSettings()});
  }
  bool is_together() const {
    return are_done_together(model, {batch.data(), batch.size()}, loss_settings, density);
  }
};

TEST(BatchChoice, StepsOfTheDefaultsAreDoneTogether) {
  for (const std::size_t photos : {2, 3, 4}) EXPECT_TRUE(Step(photos).is_together()) << photos;
  for (const std::size_t photos : {1, 5, 8}) EXPECT_FALSE(Step(photos).is_together()) << photos;
}

TEST(BatchChoice, StepsWithoutAScoreOverFragmentsAreDoneTogether) {
  Step step(2);
  step.density.score = GrowthScore::gradient;
  step.batch[0].settings.deterministic = true;
  EXPECT_TRUE(step.is_together());
  step = Step(2);
  step.density.gather_statistics = false;
  EXPECT_TRUE(step.is_together());
}

TEST(BatchChoice, OtherStepsAreNot) {
  const std::vector<std::pair<const char*, std::function<void(Step&)>>> changes = {
      {"depth map", [](Step& step) { step.view.has_depth_map = true; }},
      {"time", [](Step& step) { step.model.gaussians.has_time = true; }},
      {"absolute", [](Step& step) { step.batch[0].settings.absolute_gradient = true; }},
      {"deterministic", [](Step& step) { step.batch[0].settings.deterministic = true; }},
  };
  for (const auto& [name, change] : changes) {
    Step step(2);
    change(step);
    EXPECT_FALSE(step.is_together()) << name;
  }
}

}  // namespace
}  // namespace gs::cuda
