// SPDX-License-Identifier: Apache-2.0
// Stage 9 of the strategy "budgeted" on hand-made statistics, and its runs.
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <cmath>
#include <limits>
#include <map>
#include <set>
#include <stdexcept>

#include "gs_core/threads/parallel.h"
#include "gs_train/density/density_control.h"
#include "tests/support/scene_run.h"
#include "tests/support/small_scene.h"

namespace gs {
namespace {

using ::testing::ElementsAre;

constexpr std::uint64_t kSeed = 3;
constexpr int kStep = 600;
constexpr float kNan = std::numeric_limits<float>::quiet_NaN();

/// Rows of all kinds: small, large and huge, faint and broken, with and without gradients. The last
/// SH coefficient holds the number of the row.
TrainingModel random_model(std::size_t count, std::uint64_t seed, bool has_time = false) {
  Draws draws(seed);
  Gaussians rows(count, host_memory(), has_time);
  for (std::size_t i = 0; i < count; ++i) {
    set_gaussian(rows, i, draws.uniform3(-1, 1), 1, draws.log_uniform(0.03f, 0.9f));
    rows.log_scale[i] = Vec3f(std::log(draws.log_uniform(0.02f, 2))) + draws.uniform3(-1, 0);
    rows.rotation[i] = draws.quaternion();
    rows.sh_rest[i].coefficient[kShRestCount - 1].z = float(i);
    if (draws.chance(0.05f)) rows.mean[i].y = kNan;
    if (draws.chance(0.05f)) rows.rotation[i] = {0, 0, 0, 0};
    if (!has_time) continue;
    rows.right_rotation[i] = draws.quaternion();
    rows.time_mean[i] = draws.uniform(0, 1);
    rows.log_time_scale[i] = draws.uniform(-2, 0);
  }
  TrainingModel model = model_of(rows);
  float first = 0.5f;
  const auto number = [&](const char*, const auto& array) { number_rows(array, first += 1); };
  for_each_array(number, model.first_moment);
  for_each_array(number, model.second_moment);
  begin_sums(model);
  for (std::size_t i = 0; i < count; ++i) {
    model.statistics.visits[i] = float(draws.below(9));
    model.statistics.gradient_norm[i] = model.statistics.visits[i] * draws.uniform(0, 2);
    model.statistics.sums[i] = {float(draws.below(100)), draws.uniform(0, 5), draws.uniform(0, 5)};
  }
  return model;
}

std::size_t origin(const TrainingModel& model, std::size_t i) {
  return std::size_t(model.gaussians.sh_rest[i].coefficient[kShRestCount - 1].z);
}
std::vector<std::size_t> origins(const TrainingModel& model) {
  std::vector<std::size_t> result;
  for (std::size_t i = 0; i < model.count(); ++i) result.push_back(origin(model, i));
  return result;
}

GrowthRules like(const AdaptiveRules& limits) {
  GrowthRules rules;
  rules.limits = limits;
  return rules;
}
constexpr AdaptiveRules kLimits{.gradient_threshold = 1,
                                .small_scale = 0.1f,
                                .prune_opacity = 0.05f,
                                .prune_scale = 1,
                                .max_gaussians = 0};

RefineReport grow_by(TrainingModel& model, const GrowthRules& rules, int step = kStep) {
  return make_scalar_row_ops()->grow(model, rules, kSeed, step);
}

// ---- the same as "adaptive" --------------------------------------------------------------------

TEST(Grow, DoesWhatAdaptiveDoesBitForBitUnderItsRules) {
  for (const bool has_time : {false, true})
    for (const std::int64_t cap : {0, 1, 2400, 2600, 2900, 9000}) {
      AdaptiveRules limits = kLimits;
      limits.max_gaussians = cap;
      TrainingModel adaptive = random_model(3000, 1, has_time),
                    budgeted = random_model(3000, 1, has_time);
      const RefineReport expected = make_scalar_row_ops()->refine(
          adaptive, limits, {kSeed, RandomStream::split_gaussians}, kStep);
      const RefineReport report = grow_by(budgeted, like(limits));
      EXPECT_TRUE(same_bits(budgeted, adaptive)) << cap;
      EXPECT_EQ(report.cloned, expected.cloned);
      EXPECT_EQ(report.split, expected.split);
      EXPECT_EQ(report.pruned, expected.pruned);
      EXPECT_EQ(budgeted.statistics.visits.download(), adaptive.statistics.visits.download());
    }
}

TEST(Grow, ClearsTheMomentsThatItsRuleNames) {
  TrainingModel model = random_model(3, 2);
  make_scalar_row_ops()->lower_opacity(model, {OpacityPolicy::halve, 0.01f, MomentClearing::none});
  EXPECT_FALSE(row_is(model.first_moment.logit_opacity, 1, 0));
  make_scalar_row_ops()->lower_opacity(model, {OpacityPolicy::halve, 0.01f, MomentClearing::all});
  EXPECT_TRUE(row_is(model.second_moment.logit_opacity, 1, 0));
  EXPECT_TRUE(row_is(model.first_moment.sh_rest, 2, 0));
}

// ---- who grows ---------------------------------------------------------------------------------

/// Small visible rows that may all be cloned; row i has the score i.
TrainingModel scored_model(std::size_t count) {
  Gaussians rows(count, host_memory());
  for (std::size_t i = 0; i < count; ++i) {
    set_gaussian(rows, i, {float(i), 0, 0}, 0.05f, 0.5f);
    rows.sh_rest[i].coefficient[kShRestCount - 1].z = float(i);
  }
  TrainingModel model = model_of(rows);
  begin_sums(model);
  for (std::size_t i = 0; i < count; ++i) model.statistics.sums[i] = {1, float(i), float(i)};
  return model;
}
GrowthRules by_error(std::int64_t target, GrowthSelection select) {
  GrowthRules rules = like(kLimits);
  rules.limits.gradient_threshold = 0;
  rules.limits.max_gaussians = target;
  rules.score = GrowthScore::error;
  rules.select = select;
  return rules;
}

TEST(Grow, TakesTheLargestScores) {
  TrainingModel model = scored_model(10);
  EXPECT_EQ(grow_by(model, by_error(13, GrowthSelection::top_k)).cloned, 3u);
  EXPECT_THAT(origins(model), ElementsAre(0, 1, 2, 3, 4, 5, 6, 7, 8, 9, 7, 8, 9));
}

TEST(Grow, TakesNoRowOutsideOfTheRegion) {
  TrainingModel model = scored_model(10);
  GrowthRules rules = by_error(13, GrowthSelection::top_k);
  rules.limits.region.half_spaces[0] = {{-1, 0, 0}, -5};  // rows 0 to 5
  rules.limits.region.count = 1;
  EXPECT_EQ(grow_by(model, rules).cloned, 3u);
  EXPECT_THAT(origins(model), ElementsAre(0, 1, 2, 3, 4, 5, 6, 7, 8, 9, 3, 4, 5));
}

TEST(Grow, DrawsByTheScoreAndNeverARowWithoutOne) {
  constexpr int kSteps = 3000;
  std::vector<int> count(5);
  for (int step = 1; step <= kSteps; ++step) {
    TrainingModel model = scored_model(5);
    model.statistics.sums[4].first = kNan;
    ASSERT_EQ(grow_by(model, by_error(6, GrowthSelection::race), step).cloned, 1u);
    ++count[origin(model, 5)];
  }
  EXPECT_EQ(count[0], 0);
  EXPECT_EQ(count[4], 0);
  for (int i = 1; i <= 3; ++i)  // four standard errors
    EXPECT_NEAR(double(count[std::size_t(i)]) / kSteps, i / 6.0, 0.037);
}

TEST(Grow, DrawsARowAtMostOnce) {
  TrainingModel model = scored_model(100);
  grow_by(model, by_error(170, GrowthSelection::race));
  const std::vector<std::size_t> all = origins(model);
  ASSERT_EQ(all.size(), 170u);
  EXPECT_EQ(std::set<std::size_t>(all.begin() + 100, all.end()).size(), 70u);
}

TEST(Grow, StopsAtAShareOfTheRowsAndAtAScore) {
  TrainingModel model = scored_model(100);
  GrowthRules rules = by_error(1000, GrowthSelection::top_k);
  rules.most_growth = 0.25f;
  EXPECT_EQ(grow_by(model, rules).cloned, 25u);
  model = scored_model(100);
  rules.score_threshold = 90;
  EXPECT_EQ(grow_by(model, rules).cloned, 10u);
}

TEST(Grow, PrunesWhatWasInNoPixelWhereAsked) {
  TrainingModel model = scored_model(4);
  model.statistics.sums[2].count = 0;
  GrowthRules rules = by_error(4, GrowthSelection::top_k);
  grow_by(model, rules);
  EXPECT_EQ(model.count(), 4u);
  model = scored_model(4);
  model.statistics.sums[2].count = 0;
  rules.prunes_unseen = true;
  rules.limits.max_gaussians = 3;
  EXPECT_EQ(grow_by(model, rules).pruned, 1u);
  EXPECT_THAT(origins(model), ElementsAre(0, 1, 3));
}

TEST(Grow, WithoutTheSumsOfItsScoreIsAMistakeOfTheCaller) {
  TrainingModel model = model_of(scored_model(4).gaussians);
  EXPECT_THROW(grow_by(model, by_error(5, GrowthSelection::race)), std::logic_error);
}

// ---- what they become --------------------------------------------------------------------------

/// One large row that is split.
TrainingModel one_large() {
  TrainingModel model = scored_model(1);
  model.gaussians.log_scale[0] = {std::log(0.2f), std::log(0.8f), std::log(0.4f)};
  model.statistics.sums[0].first = 1;
  return model;
}

TEST(Grow, SplitsAlongTheLongestAxis) {
  GrowthRules rules = by_error(0, GrowthSelection::top_k);
  rules.split = {SplitPlacement::axis, 1.35f, 0.55f, 0.893f, false, 0.6f};
  TrainingModel model = one_large();
  EXPECT_EQ(grow_by(model, rules).split, 1u);
  ASSERT_EQ(model.count(), 2u);
  for (std::size_t i = 0; i < 2; ++i) {
    EXPECT_NEAR(model.gaussians.mean[i].y, (i ? -1 : 1) * 1.35f * 0.8f, 1e-6f);
    EXPECT_EQ(model.gaussians.mean[i].x, 0.0f);
    EXPECT_NEAR(std::exp(model.gaussians.log_scale[i].y), 0.55f * 0.8f, 1e-6f);
    EXPECT_NEAR(std::exp(model.gaussians.log_scale[i].x), 0.893f * 0.2f, 1e-6f);
    EXPECT_NEAR(sigmoid(model.gaussians.logit_opacity[i]), 0.3f, 1e-6f);
  }
}

TEST(Grow, KeepsTheVarianceWhereAsked) {
  GrowthRules rules = by_error(0, GrowthSelection::top_k);
  rules.split.place = SplitPlacement::variance;
  TrainingModel model = one_large();
  grow_by(model, rules);
  ASSERT_EQ(model.count(), 2u);
  const float scales[] = {0.2f, 0.8f, 0.4f};
  for (int axis = 0; axis < 3; ++axis) {
    const float half = (model.gaussians.mean[0][axis] - model.gaussians.mean[1][axis]) / 2;
    const float scale = std::exp(model.gaussians.log_scale[0][axis]);
    EXPECT_NEAR(half * half + scale * scale, scales[axis] * scales[axis], 1e-6f);
  }
}

TEST(Grow, MayKeepTheParentAsItIsBesideOneChild) {
  GrowthRules rules = by_error(0, GrowthSelection::top_k);
  rules.split.keeps_parent = true;
  TrainingModel model = one_large();
  number_rows(model.first_moment.mean, 7);
  const Gaussians before = copy_of(model.gaussians);
  const RefineReport report = grow_by(model, rules);
  EXPECT_EQ(report.split, 1u);
  EXPECT_EQ(report.pruned, 0u);
  ASSERT_EQ(model.count(), 2u);
  EXPECT_EQ(model.gaussians.mean[0], before.mean[0]);
  EXPECT_EQ(model.gaussians.log_scale[0], before.log_scale[0]);
  EXPECT_EQ(model.gaussians.logit_opacity[0], before.logit_opacity[0]);
  EXPECT_NE(model.gaussians.mean[1], before.mean[0]);
  EXPECT_NEAR(std::exp(model.gaussians.log_scale[1].y), 0.8f / 1.6f, 1e-6f);
  EXPECT_TRUE(row_is(model.first_moment.mean, 0, 7));
  EXPECT_TRUE(row_is(model.first_moment.mean, 1, 0));
}

TEST(Grow, SharesTheOpacityBetweenAnOriginalAndItsCopy) {
  GrowthRules rules = by_error(3, GrowthSelection::top_k);
  rules.split.opacity_factor = 0.6f;
  TrainingModel model = scored_model(2);
  grow_by(model, rules);
  ASSERT_EQ(model.count(), 3u);
  EXPECT_EQ(sigmoid(model.gaussians.logit_opacity[0]), 0.5f);  // did not grow
  EXPECT_NEAR(sigmoid(model.gaussians.logit_opacity[1]), 0.3f, 1e-6f);
  EXPECT_EQ(model.gaussians.logit_opacity[2], model.gaussians.logit_opacity[1]);
}

TEST(Grow, GivesTheSameBitsForAnyNumberOfThreads) {
  for (const GrowthScore score : {GrowthScore::force, GrowthScore::mask}) {
    GrowthRules rules = like(kLimits);
    rules.score = score;
    rules.select = GrowthSelection::race;
    rules.limits.gradient_threshold = 0;
    rules.limits.max_gaussians = 12000;
    rules.split = {SplitPlacement::axis, 1, 0.5f, 0.9f, false, 0.6f};
    TrainingModel a = random_model(9000, 4), b = random_model(9000, 4), c = random_model(9000, 4);
    grow_by(a, rules);
    set_thread_count(1);
    grow_by(b, rules);
    set_thread_count(0);
    grow_by(c, rules, kStep + 1);
    EXPECT_TRUE(same_bits(a, b));
    EXPECT_FALSE(same_bits(a, c));
  }
}

TEST(Grow, TakesAModelWithoutRows) {
  TrainingModel model = scored_model(0);
  EXPECT_EQ(grow_by(model, by_error(5, GrowthSelection::race)).cloned, 0u);
}

// ---- runs --------------------------------------------------------------------------------------

/// Notes the number of Gaussians after each step, and stops the run after one.
class Watcher : public Observer {
 public:
  explicit Watcher(int last_step = 0) : last_step_(last_step) {}
  void after_step(int step, Trainer& trainer) override {
    counts[step] = trainer.gaussian_count();
    if (step == last_step_) trainer.stop();
  }
  std::map<int, std::size_t> counts;

 private:
  int last_step_;
};

class BudgetedRun : public SceneRun {
 protected:
  BudgetedRun() : SceneRun(small_scene()) {}
  static Config run_with(GrowthScore score) {
    Config config = short_run();
    DensityConfig& density = config.density;
    density.strategy = "budgeted";
    density.max_gaussians = 200;
    density.score = score;
    density.select = GrowthSelection::race;
    density.curve = GrowthCurve::linear;
    density.gradient_threshold = 0;
    density.from_step = 20;
    density.every = 20;
    density.split = SplitPlacement::axis;
    density.opacity_policy = OpacityPolicy::none;
    density.prune_unseen = score != GrowthScore::gradient;
    density.until_step = 24000;
    return config;
  }
};

TEST_F(BudgetedRun, FollowsItsCurveWithEveryScore) {
  for (const GrowthScore score : {GrowthScore::gradient, GrowthScore::force, GrowthScore::error,
                                  GrowthScore::mask, GrowthScore::edge}) {
    const Config config = run_with(score);
    const Schedule schedule(config, scene_.extent, scene_.train_views.size());
    Watcher watcher;
    Trainer trainer(scene_, config, *backend_);
    trainer.add_observer(watcher);
    trainer.run();
    for (int step = 40; step < 200; step += 20) {
      const std::int64_t target = growth_target(GrowthCurve::linear, schedule.growth_share(step),
                                                std::int64_t(scene_.points.size()), 200);
      // Faint children go at once, and a small model cannot always grow enough.
      EXPECT_LE(std::int64_t(watcher.counts[step]), target) << word_of(score) << " " << step;
      EXPECT_GE(double(watcher.counts[step]), 0.8 * double(target))
          << word_of(score) << " " << step;
    }
    EXPECT_GT(evaluate(backend_->renderer(), trainer.model().gaussians.span(), scene_.train_views,
                       trainer.evaluation_settings())
                  .psnr,
              20)
        << word_of(score);
  }
}

TEST_F(BudgetedRun, WithTheSettingsOfAdaptiveIsARunOfAdaptive) {
  Config config = short_run();
  config.train.iterations = 150;
  config.density.from_step = config.density.every = 20;
  config.density.gradient_threshold = 1e-5f;
  config.density.reset_opacity_every = 50;
  const TrainingModel adaptive = trained(config);
  config.density.strategy = "budgeted";
  EXPECT_TRUE(same_bits(trained(config), adaptive));
  EXPECT_GT(adaptive.count(), 2 * scene_.points.size());
}

TEST_F(BudgetedRun, GoesOnFromACheckpointAsIfItHadNeverStopped) {
  for (const GrowthScore score : {GrowthScore::force, GrowthScore::edge}) {
    Config config = run_with(score);
    config.train.iterations = 130;
    LastState kept;
    Watcher watcher(66);  // between two refinements
    Trainer first(scene_, config, *backend_);
    first.keep_checkpoints_in(kept);
    first.add_observer(watcher);
    first.run();
    EXPECT_EQ(kept.state.progress.step, 67);
    EXPECT_TRUE(kept.state.model.statistics.has_sums);
    Trainer rest(scene_, config, *backend_, std::move(kept.state));
    rest.run();
    EXPECT_TRUE(same_bits(copy_to(host_memory(), rest.model()), trained(config)));
  }
}

TEST_F(BudgetedRun, PrunesSharesAtTheirSteps) {
  const Config config = busy_run();
  Watcher watcher;
  Trainer trainer(scene_, config, *backend_);
  trainer.add_observer(watcher);
  trainer.run();
  std::map<int, std::size_t>& counts = watcher.counts;
  EXPECT_EQ(counts[40], counts[39] - share_of(counts[39], double(0.1f)));
  EXPECT_EQ(counts[64], counts[63] - share_of(counts[63], double(0.3f)));
  EXPECT_EQ(counts[60], counts[59]);  // no refinement while sensitivities are measured
  EXPECT_GT(counts[80], counts[79]);
}

TEST_F(BudgetedRun, GoesOnFromAnyStepOfAMeasurement) {
  const Config config = busy_run();
  const TrainingModel whole = trained(config);
  for (const int stop : {36, 57, 60, 63, 64, 77}) {
    LastState kept;
    StopAfter watcher(stop);
    Trainer first(scene_, config, *backend_);
    first.keep_checkpoints_in(kept);
    first.add_observer(watcher);
    first.run();
    Trainer rest(scene_, config, *backend_, std::move(kept.state));
    rest.run();
    EXPECT_TRUE(same_bits(copy_to(host_memory(), rest.model()), whole)) << stop;
  }
}

TEST_F(BudgetedRun, WithEverythingGivesTheSameBitsForAnyNumberOfThreads) {
  const Config config = busy_run();
  set_thread_count(1);
  const TrainingModel one = trained(config);
  set_thread_count(0);
  EXPECT_TRUE(same_bits(trained(config), one));
}

TEST_F(BudgetedRun, GivesTheSameBitsForAnyNumberOfThreads) {
  Config config = run_with(GrowthScore::error);
  config.train.iterations = 90;
  set_thread_count(1);
  const TrainingModel one = trained(config);
  set_thread_count(0);
  EXPECT_TRUE(same_bits(trained(config), one));
}

TEST_F(BudgetedRun, AddsGaussiansInTheRegionOfTheSettingAlone) {
  Config config = run_with(GrowthScore::error);
  const auto count_with = [&](const std::string& region) {
    config.density.region = region;
    return trained(config).count();
  };
  EXPECT_LE(count_with("0,1,0,1000"), scene_.points.size());  // it holds nothing of the scene
  EXPECT_GT(count_with("0,1,0,-1000"), scene_.points.size());
}

TEST_F(BudgetedRun, TakesTheRegionInTheCoordinatesOfThePhotos) {
  Scene far = scene_;
  far.world_offset = {0.0, 5e6, 0.0};
  Config config = run_with(GrowthScore::error);
  config.density.region = "0,1,0,4999000";
  Trainer trainer(far, config, *backend_);
  trainer.run();
  EXPECT_GT(trainer.model().count(), far.points.size());
}

}  // namespace
}  // namespace gs
