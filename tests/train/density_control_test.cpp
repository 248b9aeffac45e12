// SPDX-License-Identifier: Apache-2.0
// Strategies of density control: how they are chosen, and what they ask for in which step.
#include "gs_train/density/density_control.h"

#include <gtest/gtest.h>
#include <spdlog/fmt/fmt.h>

#include "gs_core/config/config_words.h"
#include "gs_core/error.h"
#include "tests/support/models.h"

namespace gs {
namespace {

Config with_strategy(const std::string& name) {
  Config config;
  config.density.strategy = name;
  config.density.max_gaussians = 1000;
  return config;
}
std::unique_ptr<DensityControl> control_of(const Config& config) {
  return make_density_control(config, Schedule(config, 2), 2);
}

/// Thirty Gaussians that grow because of two views or a gradient.
TrainingModel growing_model() {
  Gaussians gaussians(30, host_memory());
  for (std::size_t i = 0; i < 30; ++i) set_gaussian(gaussians, i, {float(i), 0, 0}, 0.001f, 0.5f);
  TrainingModel model = model_of(gaussians);
  for (std::size_t i = 0; i < 30; ++i) {
    model.statistics.visits[i] = 2;
    model.statistics.gradient_norm[i] = 1;
  }
  return model;
}

TEST(DensityControl, TheSettingTakesEveryStrategyOfTheTableAndNoOther) {
  for (const std::string& name : density_strategies()) {
    EXPECT_NE(control_of(with_strategy(name)), nullptr) << name;
    validate(with_strategy(name));
  }
  EXPECT_EQ(fmt::format("{}", fmt::join(density_strategies(), ", ")), kStrategyWords);
}

TEST(DensityControl, AnUnknownStrategyIsNamedWithTheKnownOnes) {
  try {
    control_of(with_strategy("mcmcc"));
    FAIL();
  } catch (const UsageError& error) {
    EXPECT_NE(std::string(error.what()).find("mcmcc; it is one of adaptive, mcmc"),
              std::string::npos);
  }
}

TEST(AdaptiveControl, AsksForStatisticsAloneAndClones) {
  const auto control = control_of(with_strategy("adaptive"));
  EXPECT_TRUE(control->of_step(600).gather_statistics);
  EXPECT_FALSE(control->of_step(20000).gather_statistics);
  EXPECT_FALSE(control->of_step(600).regularizers.any());
  EXPECT_EQ(control->of_step(600).noise.scale, 0.0f);
  const auto backend = make_scalar_backend();
  TrainingModel model = growing_model();
  EXPECT_EQ(control->after_step(model, *backend, 601).cloned, 0u);
  EXPECT_EQ(control->after_step(model, *backend, 600).cloned, 30u);
  EXPECT_EQ(model.count(), 60u);
}

TEST(AdaptiveControl, ResetsOpacities) {
  const auto control = control_of(with_strategy("adaptive"));
  const auto backend = make_scalar_backend();
  TrainingModel model = growing_model();
  control->after_step(model, *backend, 3000);
  EXPECT_NEAR(sigmoid(model.gaussians.logit_opacity[0]), 0.01f, 1e-6f);
}

TEST(McmcControl, AsksForRegularizersAndTheNoiseOfItsStep) {
  const auto control = control_of(with_strategy("mcmc"));
  const DensityStep step = control->of_step(77);
  EXPECT_FALSE(step.gather_statistics);
  EXPECT_EQ(step.regularizers.opacity, 0.01f);
  EXPECT_EQ(step.regularizers.scale, 0.01f);
  EXPECT_EQ(step.noise.scale, 5e5f);
  EXPECT_EQ(step.noise.step, 77);
  EXPECT_EQ(step.noise.random.seed, 42u);
}

TEST(McmcControl, GrowsByAShareUpToTheCapAndNeverResetsOpacities) {
  Config config = with_strategy("mcmc");
  config.density.growth = 0.1f;
  config.density.max_gaussians = 35;
  const auto control = control_of(config);
  const auto backend = make_scalar_backend();
  TrainingModel model = growing_model();
  control->after_step(model, *backend, 601);
  EXPECT_EQ(model.count(), 30u);
  control->after_step(model, *backend, 600);
  EXPECT_EQ(model.count(), 33u);
  control->after_step(model, *backend, 3000);
  EXPECT_EQ(model.count(), 35u);
  control->after_step(model, *backend, 3100);
  EXPECT_EQ(model.count(), 35u);
  float most = 0;
  for (const float logit : model.gaussians.logit_opacity) most = std::max(most, sigmoid(logit));
  EXPECT_GT(most, 0.2f);
}

TEST(McmcControl, WithoutACapSaysHowToGiveOne) {
  Config config = with_strategy("mcmc");
  config.density.max_gaussians = 0;
  EXPECT_THROW(control_of(config), UsageError);
  EXPECT_THROW(validate(config), UsageError);
}

TEST(MaxGaussians, MayBeAuto) {
  Config config;
  apply_setting(config, "density.max_gaussians=auto");
  EXPECT_EQ(config.density.max_gaussians, kAutoCount);
  validate(config);
  apply_setting(config, "density.max_gaussians=12");
  EXPECT_EQ(config.density.max_gaussians, 12);
  EXPECT_THROW(apply_setting(config, "density.max_gaussians=-2"), UsageError);
  EXPECT_THROW(apply_setting(config, "density.max_gaussians=some"), UsageError);
}

}  // namespace
}  // namespace gs
