// SPDX-License-Identifier: Apache-2.0
// Density control: how methods are chosen, and what their rules ask for in which step. What each
// method does is in methods_test.cpp.
#include "gs_train/density/density_control.h"

#include "tests/support/adaptive.h"
#include "tests/support/models.h"
#include "tests/support/scoring_backend.h"

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

TEST(DensityControl, TheSettingTakesEveryMethodAndNoOther) {
  for (const NamedMethod& row : growth_methods()) {
    EXPECT_NE(control_of(with_strategy(row.name)), nullptr) << row.name;
    validate(with_strategy(row.name));
  }
  EXPECT_THROW(validate(with_strategy("mcmcc")), UsageError);
}

TEST(DensityControl, AnUnknownStrategyIsNamedWithTheKnownOnes) {
  EXPECT_THAT([] { control_of(with_strategy("mcmcc")); },
              ThrowsMessage<UsageError>(HasSubstr("mcmcc; it is one of growth, adaptive, absgs")));
}

TEST(GrowthControl, OfAdaptiveAsksForStatisticsAloneAndClones) {
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

TEST(DensityControl, EveryMethodGrowsInItsRegionAlone) {
  Region region;
  region.half_spaces[0] = {{1, 0, 0}, 20};  // rows 20 to 29
  region.count = 1;
  for (const NamedMethod& row : growth_methods()) {
    Config config = with_strategy(row.name);
    config.density.growth = 1;
    const auto control = control_of(config);
    control->set_region(region);
    TrainingModel model = growing_model();
    begin_sums(model);
    ScoringBackend backend;
    backend.sums.assign(30, {1, 1, 1e5});
    model.statistics.sums.upload(backend.sums);
    control->after_step(model, backend, 14900);
    EXPECT_GT(model.count(), 30u) << row.name;
    for (std::size_t i = 30; i < model.count(); ++i)
      EXPECT_GE(model.gaussians.mean[i].x, 20) << row.name;
  }
}

// ---- the rules of methods ----------------------------------------------------------------------

std::unique_ptr<DensityControl> control_of(const GrowthMethod& method, std::size_t views = 0) {
  const Config config = with_strategy("adaptive");
  return make_growth_control(config, method, Schedule(config, method, 2, views), 2);
}

TEST(GrowthControl, AsksStepsForTheSumsOfForcesAlone) {
  GrowthMethod method;
  method.score = GrowthScore::force;
  EXPECT_EQ(control_of(method)->of_step(600).fragment_statistic(), FragmentStatistic::force);
  EXPECT_EQ(control_of(method)->of_step(20000).fragment_statistic(), FragmentStatistic::none);
  for (const GrowthMethod& other : {adaptive_method(), fastgs_method(), improved_gs_method()}) {
    EXPECT_TRUE(control_of(other)->of_step(600).gather_statistics);
    EXPECT_EQ(control_of(other)->of_step(600).fragment_statistic(), FragmentStatistic::none);
  }
}

// ---- score passes ------------------------------------------------------------------------------

ScorePhotos some_photos(const std::vector<View>& views) {
  return {views.size(), [&views](std::size_t photo, int) {
            return TrainingPhoto{&views[photo], {}, 1, photo};
          }};
}

TEST(ScorePasses, DrawTenPhotosThatSeedAndStepDecide) {
  const std::vector<View> views(40);
  TrainingModel model = growing_model();
  const auto drawn_at = [&](int step, std::uint64_t seed) {
    Config config = with_strategy("taming");
    config.train.seed = seed;
    const auto control = control_of(config);
    control->set_photos(some_photos(views));
    ScoringBackend backend;
    control->after_step(model, backend, step);
    return backend.photos;
  };
  const std::vector<std::size_t> drawn = drawn_at(700, 1);
  EXPECT_EQ(drawn.size(), 10u);
  EXPECT_EQ(std::set<std::size_t>(drawn.begin(), drawn.end()).size(), 10u);
  EXPECT_EQ(drawn_at(700, 1), drawn);
  EXPECT_NE(drawn_at(800, 1), drawn);
  EXPECT_NE(drawn_at(700, 2), drawn);
  EXPECT_TRUE(drawn_at(701, 1).empty());  // no refinement
}

TEST(ScorePasses, TakeAllPhotosWhereThereAreFewer) {
  const std::vector<View> views(3);
  const auto control = control_of(with_strategy("fastgs"));
  control->set_photos(some_photos(views));
  ScoringBackend backend;
  TrainingModel model = growing_model();
  control->after_step(model, backend, 700);
  EXPECT_EQ(backend.photos, (std::vector<std::size_t>{0, 1, 2}));
  EXPECT_EQ(backend.rule, (PixelRule{GrowthScore::mask, 0.1f}));
}

TEST(GrowthControl, WithoutTheNumberOfItsCurveSaysHowToGiveIt) {
  Config config = with_strategy("fastgs");
  config.density.max_gaussians = 0;
  for (const char* with_curve : {"improved_gs", "mcmc"}) {
    config.density.strategy = with_curve;
    EXPECT_THROW(control_of(config), UsageError);
    EXPECT_THROW(validate(config), UsageError);
  }
  config.density.strategy = "fastgs";  // without a curve
  EXPECT_NE(control_of(config), nullptr);
  validate(config);
}

// Refinements are 100 steps apart: fewer than 150 photos.
TEST(GrowthControl, PrunesTheUnseenOnlyAfterAWholeEpoch) {
  GrowthMethod method;
  method.prune_unseen = true;
  method.score = GrowthScore::force;
  const auto backend = make_scalar_backend();
  for (const std::size_t views : {100, 150}) {
    TrainingModel model = growing_model();
    begin_sums(model);
    for (std::size_t i = 0; i < 20; ++i) model.statistics.sums[i].count = 1;
    control_of(method, views)->after_step(model, *backend, 1000);
    EXPECT_EQ(model.count(), views == 100 ? 20u : 30u);
  }
}

TEST(GrowthControl, CapsOpacitiesAfterARefinementAndClearsTheirMoments) {
  GrowthMethod method;
  method.opacity_cap = 0.3f;
  const auto control = control_of(method);
  const auto backend = make_scalar_backend();
  TrainingModel model = growing_model();
  number_moments(model, 1);
  control->after_step(model, *backend, 601);
  EXPECT_NEAR(sigmoid(model.gaussians.logit_opacity[0]), 0.5f, 1e-6f);
  EXPECT_TRUE(moments_are(float_moments(model).logit_opacity, 5, 6));
  control->after_step(model, *backend, 600);
  for (const float logit : model.gaussians.logit_opacity) EXPECT_NEAR(sigmoid(logit), 0.3f, 1e-6f);
  EXPECT_TRUE(moments_are(float_moments(model).logit_opacity, 5, 0));
}

TEST(GrowthControl, MeasuresSensitivitiesAndRemovesTheLowest) {
  GrowthMethod method = speedy_splat_method();
  method.soft_prune = 0.5f;
  const auto control = control_of(method, 100);
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

TEST(GrowthControl, RefusesPruningThatItsScoreDoesNotAllow) {
  GrowthMethod unseen;
  unseen.prune_unseen = true;  // by the score "gradient", which counts no pixels
  EXPECT_THROW(control_of(unseen), std::logic_error);
  GrowthMethod shares = speedy_splat_method();
  shares.score = GrowthScore::edge;  // whose sums are no sensitivities
  shares.score_photos = 10;
  EXPECT_THROW(control_of(shares), std::logic_error);
  GrowthMethod without_photos;
  without_photos.score = GrowthScore::edge;
  EXPECT_THROW(control_of(without_photos), std::logic_error);
}

// ---- all methods -------------------------------------------------------------------------------

TEST(DensityControl, WeighsOpacityAndScaleUnderEveryMethodAsTheSettingsSay) {
  for (const NamedMethod& row : growth_methods()) {
    const std::string name = row.name;
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
