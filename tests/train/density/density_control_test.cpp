// SPDX-License-Identifier: Apache-2.0
// Strategies of density control: how they are chosen, and what they ask for in which step.
#include "gs_train/density/density_control.h"

#include <gtest/gtest.h>
#include <spdlog/fmt/fmt.h>

#include "gs_core/config/config_words.h"
#include "gs_core/error.h"
#include "tests/support/adaptive.h"
#include "tests/support/models.h"

namespace gs {
namespace {

Config with_strategy(const std::string& name) {
  Config config = adaptive_config();
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
    EXPECT_NE(std::string(error.what()).find("mcmcc; it is one of adaptive, budgeted, mcmc"),
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

TEST(DensityControl, EveryStrategyGrowsInItsRegionAlone) {
  const auto backend = make_scalar_backend();
  Region region;
  region.half_spaces[0] = {{1, 0, 0}, 20};  // rows 20 to 29
  region.count = 1;
  for (const std::string& name : density_strategies()) {
    Config config = with_strategy(name);
    config.density.growth = 1;
    const auto control = control_of(config);
    control->set_region(region);
    TrainingModel model = growing_model();
    const RefineReport report = control->after_step(model, *backend, 600);
    EXPECT_GE(report.cloned, 10u) << name;
    for (std::size_t i = 30; i < model.count(); ++i)
      EXPECT_GE(model.gaussians.mean[i].x, 20) << name;
  }
}

TEST(AdaptiveControl, ResetsOpacities) {
  const auto control = control_of(with_strategy("adaptive"));
  const auto backend = make_scalar_backend();
  TrainingModel model = growing_model();
  control->after_step(model, *backend, 3000);
  EXPECT_NEAR(sigmoid(model.gaussians.logit_opacity[0]), 0.01f, 1e-6f);
}

TEST(BudgetedControl, AsksForTheSumsOfItsScore) {
  Config config = with_strategy("budgeted");
  config.density.score = GrowthScore::mask;
  config.density.mask_error = 0.3f;
  const auto control = control_of(config);
  EXPECT_EQ(control->of_step(600).score, GrowthScore::mask);
  EXPECT_EQ(control->of_step(600).mask_error, 0.3f);
  EXPECT_TRUE(control->of_step(600).gather_statistics);
  EXPECT_FALSE(control->of_step(20000).gather_statistics);
}

TEST(BudgetedControl, DoesWhatAdaptiveDoesByDefault) {
  const auto adaptive = control_of(with_strategy("adaptive")),
             budgeted = control_of(with_strategy("budgeted"));
  const auto backend = make_scalar_backend();
  TrainingModel a = growing_model(), b = growing_model();
  for (const int step : {600, 601, 3000, 3100}) {
    EXPECT_EQ(budgeted->after_step(b, *backend, step).cloned,
              adaptive->after_step(a, *backend, step).cloned);
    EXPECT_TRUE(same_bits(a, b)) << step;
    EXPECT_EQ(budgeted->of_step(step).gather_statistics, adaptive->of_step(step).gather_statistics);
  }
}

// The 30 Gaussians may become 130; at step 600 the window begins, at 7,800 half of it is over.
TEST(BudgetedControl, FollowsItsCurve) {
  Config config = with_strategy("budgeted");
  config.density.max_gaussians = 130;
  config.density.until_step = 15000;
  config.density.curve = GrowthCurve::linear;
  const auto control = control_of(config);
  const auto backend = make_scalar_backend();
  for (const auto& [step, count] : {std::pair{600, 30}, {2000, 40}, {2500, 43}, {15000, 60}}) {
    TrainingModel model = growing_model();
    control->after_step(model, *backend, step);
    EXPECT_EQ(model.count(), std::size_t(count)) << step;  // at most twice as many
  }
}

TEST(BudgetedControl, SubtractsLessAndLessFromOpacities) {
  Config config = with_strategy("budgeted");
  config.density.opacity_policy = OpacityPolicy::subtract;
  config.density.opacity_amount = 0.1f;
  const auto control = control_of(config);
  const auto backend = make_scalar_backend();
  TrainingModel early = growing_model(), late = growing_model();
  control->after_step(early, *backend, 3000);
  EXPECT_NEAR(sigmoid(early.gaussians.logit_opacity[0]), 0.5f - 0.1f * 0.9f, 1e-6f);
  control->after_step(late, *backend, 12000);
  EXPECT_NEAR(sigmoid(late.gaussians.logit_opacity[0]), 0.5f - 0.1f * 0.6f, 1e-6f);
}

TEST(BudgetedControl, LeavesOpacitiesAloneWhereAsked) {
  Config config = with_strategy("budgeted");
  config.density.opacity_policy = OpacityPolicy::none;
  TrainingModel model = growing_model();
  control_of(config)->after_step(model, *make_scalar_backend(), 3000);
  EXPECT_NEAR(sigmoid(model.gaussians.logit_opacity[0]), 0.5f, 1e-6f);
}

TEST(BudgetedControl, WithoutTheNumberOfItsCurveSaysHowToGiveIt) {
  Config config = with_strategy("budgeted");
  config.density.curve = GrowthCurve::root;
  config.density.max_gaussians = 0;
  EXPECT_THROW(control_of(config), UsageError);
  EXPECT_THROW(validate(config), UsageError);
  config.density.curve = GrowthCurve::none;
  EXPECT_NE(control_of(config), nullptr);
  validate(config);
}

TEST(BudgetedControl, PrunesTheUnseenOnlyWithAScoreThatCountsPixels) {
  Config config = with_strategy("budgeted");
  config.density.prune_unseen = true;
  EXPECT_THROW(control_of(config), UsageError);
  EXPECT_THROW(validate(config), UsageError);
  config.density.score = GrowthScore::force;
  EXPECT_NE(control_of(config), nullptr);
  validate(config);
}

// Refinements are 100 steps apart: fewer than 150 photos.
TEST(BudgetedControl, PrunesTheUnseenOnlyAfterAWholeEpoch) {
  Config config = with_strategy("budgeted");
  config.density.prune_unseen = true;
  config.density.score = GrowthScore::force;
  const auto backend = make_scalar_backend();
  for (const std::size_t views : {100, 150}) {
    TrainingModel model = growing_model();
    begin_sums(model);
    for (std::size_t i = 0; i < 20; ++i) model.statistics.sums[i].count = 1;
    make_density_control(config, Schedule(config, 2, views), 2)->after_step(model, *backend, 1000);
    EXPECT_EQ(model.count(), views == 100 ? 20u : 30u);
  }
}

TEST(BudgetedControl, CapsOpacitiesAfterARefinementAndClearsTheirMoments) {
  Config config = with_strategy("budgeted");
  config.density.opacity_cap = 0.3f;
  config.density.opacity_policy = OpacityPolicy::none;
  const auto control = control_of(config);
  const auto backend = make_scalar_backend();
  TrainingModel model = growing_model();
  number_rows(model.first_moment.logit_opacity, 1);
  control->after_step(model, *backend, 601);
  EXPECT_NEAR(sigmoid(model.gaussians.logit_opacity[0]), 0.5f, 1e-6f);
  EXPECT_EQ(model.first_moment.logit_opacity[5], 6.0f);
  control->after_step(model, *backend, 600);
  for (const float logit : model.gaussians.logit_opacity) EXPECT_NEAR(sigmoid(logit), 0.3f, 1e-6f);
  EXPECT_EQ(model.first_moment.logit_opacity[5], 0.0f);
}

// Statistics come from the 100 photos of steps 601 to 700; the score is a sum over them.
TEST(BudgetedControl, ComparesSumsForEachPhotoWithItsThreshold) {
  Config config = with_strategy("budgeted");
  config.density.score = GrowthScore::mask;
  config.density.gradient_threshold = 0;
  config.density.score_threshold = 6;
  const auto backend = make_scalar_backend();
  TrainingModel model = growing_model();
  begin_sums(model);
  for (std::size_t i = 0; i < 30; ++i)
    model.statistics.sums[i] = {1, 0, i < 10 ? 600.0f : i < 20 ? 599.0f : 5.0f};
  EXPECT_EQ(control_of(config)->after_step(model, *backend, 700).cloned, 10u);
}

TEST(BudgetedControl, RemovesTheFaintestAfterAReset) {
  Config config = with_strategy("budgeted");
  config.density.recovery_prune = 0.1f;
  const auto backend = make_scalar_backend();
  TrainingModel model = growing_model();
  for (std::size_t i = 0; i < 30; ++i) model.gaussians.logit_opacity[i] = float(i % 10);
  const RefineReport report = control_of(config)->after_step(model, *backend, 3300);
  EXPECT_EQ(report.pruned, 3u);
  EXPECT_EQ(report.cloned, 0u);
  ASSERT_EQ(model.count(), 27u);
  for (std::size_t i = 0; i < 27; ++i) EXPECT_GT(model.gaussians.logit_opacity[i], 0.0f);
}

TEST(BudgetedControl, MeasuresSensitivitiesAndRemovesTheLowest) {
  Config config = with_strategy("budgeted");
  config.density.soft_prune = 0.5f;
  const auto control = make_density_control(config, Schedule(config, 2, 100), 2);
  EXPECT_EQ(control->of_step(5900).score, GrowthScore::gradient);
  EXPECT_EQ(control->of_step(5901).score, GrowthScore::force);
  EXPECT_EQ(control->of_step(5901).fragment_statistic(), FragmentStatistic::force);
  const auto backend = make_scalar_backend();
  TrainingModel model = growing_model();
  begin_sums(model);
  for (std::size_t i = 0; i < 30; ++i) model.statistics.sums[i].second = float((7 * i) % 30);
  EXPECT_EQ(control->after_step(model, *backend, 6000).pruned, 15u);
  ASSERT_EQ(model.count(), 15u);
  for (std::size_t i = 0; i < 15; ++i)
    EXPECT_GE((7 * int(model.gaussians.mean[i].x)) % 30, 15) << i;
  for (const FragmentSums& sums : model.statistics.sums) EXPECT_EQ(sums.second, 0.0f);
  for (const float visits : model.statistics.visits) EXPECT_EQ(visits, 0.0f);
}

TEST(BudgetedControl, RemovesTheFaintLate) {
  Config config = with_strategy("budgeted");
  config.density.late_prune_opacity = 0.1f;
  const auto control = control_of(config);
  const auto backend = make_scalar_backend();
  TrainingModel model = growing_model();
  model.gaussians.logit_opacity[3] = logit(0.09f);
  EXPECT_EQ(control->after_step(model, *backend, 15000).pruned, 0u);
  EXPECT_EQ(control->after_step(model, *backend, 18000).pruned, 1u);
  EXPECT_EQ(model.count(), 29u);
}

TEST(BudgetedControl, RefusesPruningThatItsScoreDoesNotAllow) {
  Config config = with_strategy("budgeted");
  config.density.soft_prune = 0.5f;
  config.density.score = GrowthScore::edge;
  EXPECT_THROW(control_of(config), UsageError);
  EXPECT_THROW(validate(config), UsageError);
  config.density.score = GrowthScore::force;
  EXPECT_NE(control_of(config), nullptr);
  validate(config);
}

TEST(DensityControl, WeighsOpacityAndScaleUnderEveryStrategyAsTheSettingsSay) {
  for (const std::string& name : density_strategies()) {
    Config config = with_strategy(name);
    EXPECT_FALSE(control_of(config)->of_step(77).regularizers.any()) << name;
    config.density.opacity_regularizer = 0.02f;
    config.density.scale_regularizer = 0.03f;
    config.density.velocity_regularizer = 0.04f;  // of scenes that move
    const Regularizers weights = control_of(config)->of_step(77).regularizers;
    EXPECT_EQ(weights.opacity, 0.02f) << name;
    EXPECT_EQ(weights.scale, 0.03f) << name;
    EXPECT_EQ(weights.velocity, 0.0f) << name;
  }
}

TEST(McmcControl, OfThePresetAsksForRegularizersAndTheNoiseOfItsStep) {
  Config config = adaptive_config();
  load_config(config, "mcmc");
  const auto control = control_of(config);
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
  Config config = adaptive_config();
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
