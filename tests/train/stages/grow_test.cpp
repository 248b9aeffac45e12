// SPDX-License-Identifier: Apache-2.0
// Stage 9 of the methods that grow on hand-made statistics, and their runs.
#include <stdexcept>

#include "gs_train/density/density_control.h"
#include "gs_train/row_rules.h"
#include "tests/support/scene_run.h"

namespace gs {
namespace {

constexpr std::uint64_t kSeed = 3;
constexpr int kStep = 600;

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
  number_moments(model, 1, 1);
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

TEST(Grow, ClearsTheMomentsThatItsRuleNames) {
  TrainingModel model = random_model(3, 2);
  make_scalar_row_ops()->lower_opacity(model, {OpacityPolicy::halve, 0.01f, MomentClearing::none});
  EXPECT_FALSE(moments_are(float_moments(model).logit_opacity, 1, 0));
  make_scalar_row_ops()->lower_opacity(model, {OpacityPolicy::halve, 0.01f, MomentClearing::all});
  EXPECT_TRUE(moments_are(float_moments(model).logit_opacity, 1, 0));
  EXPECT_TRUE(moments_are(float_moments(model).sh_rest, 2, 0));
}

// ---- actions that are given --------------------------------------------------------------------

/// Five rows that differ, with moments and statistics of their own.
TrainingModel numbered_model() {
  TrainingModel model = random_model(200, 1);
  std::vector<std::uint32_t> sound;
  for (std::uint32_t i = 0; sound.size() < 5; ++i)
    if (!is_invisible(model.gaussians.span(), i, 0)) sound.push_back(i);
  gather_rows(model.columns(), {sound.data(), sound.size()});
  for (std::size_t i = 0; i < 5; ++i)
    model.gaussians.sh_rest[i].coefficient[kShRestCount - 1].z = float(i);
  number_moments(model, 1);
  number_rows(model.statistics.visits, 1);
  return model;
}

TEST(Apply, DoesWithEachRowWhatItIsTold) {
  using enum GrowthAction;
  TrainingModel model = numbered_model();
  const Vec3f parent = model.gaussians.log_scale[3];
  const GrowthAction actions[] = {keep, prune, clone, split, keep};
  const RefineReport report = make_scalar_row_ops()->apply(model, {actions, 5}, {}, kSeed, kStep);
  EXPECT_THAT(origins(model), ElementsAre(0, 2, 4, 2, 3, 3));
  EXPECT_THAT(model.statistics.visits.download(), ElementsAre(1, 3, 5, 0, 0, 0));
  for (std::size_t i = 0; i < 6; ++i)
    EXPECT_TRUE(moments_are(model, i, i < 3 ? std::uint32_t(origin(model, i) + 1) : 0)) << i;
  EXPECT_EQ(model.gaussians.log_scale[4], split_log_scale(parent));
  EXPECT_NE(model.gaussians.mean[4], model.gaussians.mean[5]);
  EXPECT_EQ(report.cloned + report.split + report.pruned, 3u);
}

TEST(Apply, SplitsIntoAsManyPartsAsTheRulesSay) {
  TrainingModel model = numbered_model();
  const std::vector<GrowthAction> actions(5, GrowthAction::split);
  SplitRules rules;
  rules.parts = 3;
  make_scalar_row_ops()->apply(model, {actions.data(), 5}, rules, kSeed, kStep);
  EXPECT_THAT(origins(model), ElementsAre(0, 0, 0, 1, 1, 1, 2, 2, 2, 3, 3, 3, 4, 4, 4));
}

TEST(Apply, OfTheActionsOfARefinementIsThatRefinement) {
  for (const bool has_time : {false, true}) {
    TrainingModel refined = random_model(500, 4, has_time), model = random_model(500, 4, has_time);
    GrowthRules rules = like(kLimits);
    rules.limits.prune_opacity = 0;
    rules.limits.prune_scale = std::numeric_limits<float>::infinity();
    std::vector<GrowthAction> actions;
    for (std::size_t i = 0; i < model.count(); ++i)
      actions.push_back(growth_action(model.gaussians.span(), span_of(model.statistics), i, rules));
    const RefineReport expected = grow_by(refined, rules);
    EXPECT_GT(expected.cloned * expected.split * expected.pruned, 0u);
    const RefineReport report = make_scalar_row_ops()->apply(
        model, {actions.data(), actions.size()}, rules.split, kSeed, kStep);
    clear_columns(model, RowRole::statistic);
    EXPECT_TRUE(same_bits(model, refined));
    EXPECT_EQ(report.pruned, expected.pruned);
  }
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

TEST(Grow, MayKeepTheParentAsItIsBesideOneChild) {
  GrowthRules rules = by_error(0, GrowthSelection::top_k);
  rules.split.keeps_parent = true;
  TrainingModel model = one_large();
  number_moments(model, 7);
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
  EXPECT_TRUE(moments_are(model, 0, 7));
  EXPECT_TRUE(moments_are(model, 1, 0));
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
    with_threads(1, [&] { return grow_by(b, rules); });
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

class GrowthRun : public SceneRun {
 protected:
  GrowthRun() : SceneRun(small_scene()) {}
  /// Without opacities that are lowered.
  static Config run_of(const std::string& strategy) {
    Config config = short_run();
    DensityConfig& density = config.density;
    density.strategy = strategy;
    density.max_gaussians = 200;
    density.gradient_threshold = 0;
    density.from_step = 20;
    density.every = 20;
    density.until_step = 24000;
    density.reset_opacity_until = 0;
    return config;
  }
  /// The number of Gaussians after each step of a run.
  static std::map<int, std::size_t> counts_of(Trainer& trainer) {
    std::map<int, std::size_t> counts;
    After watcher([&](int step, Trainer& now) { counts[step] = now.gaussian_count(); });
    trainer.add_observer(watcher);
    trainer.run();
    return counts;
  }
};

TEST_F(GrowthRun, FollowsTheCurveOfItsMethod) {
  for (const char* strategy : {"growth", "dash_gaussian", "improved_gs", "litegs", "taming"}) {
    const Config config = run_of(strategy);
    const Schedule schedule(config, scene_.extent, scene_.train_views.size());
    const GrowthMethod& method = growth_method(strategy);
    Trainer trainer(scene_, config, *backend_);
    std::map<int, std::size_t> counts = counts_of(trainer);
    for (int step = 100; step < 200; step += 20) {
      const std::int64_t target =
          growth_target(method.curve, schedule.growth_share(step),
                        std::int64_t(scene_.points.size()), 200, double(method.ramp_from));
      // Faint children go at once, and a small model cannot always grow enough.
      EXPECT_LE(std::int64_t(counts[step]), target) << strategy << " " << step;
      EXPECT_GE(double(counts[step]), 0.8 * double(target)) << strategy << " " << step;
    }
    EXPECT_GT(psnr_of(*backend_, trainer, scene_.train_views), 20) << strategy;
  }
}

TEST_F(GrowthRun, GoesOnFromACheckpointAsIfItHadNeverStopped) {
  for (const char* strategy : {"growth", "improved_gs"}) {
    Config config = run_of(strategy);
    config.train.iterations = 130;
    expect_goes_on_after({66}, config);  // between two refinements
  }
}

// Opacities are lowered at step 30, and the faintest go 300 steps later, where nothing grows.
TEST_F(GrowthRun, OfImprovedGsRemovesTheFaintestAfterAReset) {
  Config config = run_of("improved_gs");
  config.train.iterations = 340;
  config.density.every = 10;
  config.density.reset_opacity_every = 30;
  config.density.reset_opacity_until = 30000;
  Trainer trainer(scene_, config, *backend_);
  std::map<int, std::size_t> counts = counts_of(trainer);
  EXPECT_EQ(counts[330], counts[329] - share_of(counts[329], double(0.2f)));
}

/// A run of Speedy-Splat that removes 80 % at step 1000, by sensitivities that the epoch before has.
class SpeedyRun : public GrowthRun {
 protected:
  SpeedyRun() {
    config_.train.iterations = 1120;
    config_.density.until_step = 29900;
  }
  Config config_ = run_of("speedy_splat");
  const int epoch_ = int(scene_.train_views.size());
  const int measured_ = 1000 / epoch_ * epoch_;  // the last step of that epoch
};

TEST_F(SpeedyRun, RemovesTheLeastSensitiveWithoutARefinementInBetween) {
  Trainer trainer(scene_, config_, *backend_);
  std::map<int, std::size_t> counts = counts_of(trainer);
  EXPECT_EQ(counts[999], counts[measured_ - epoch_]);
  EXPECT_EQ(counts[1000], counts[999] - share_of(counts[999], double(0.8f)));
  EXPECT_GT(counts[1040], counts[1000]);
}

TEST_F(SpeedyRun, GoesOnFromAnyStepOfAMeasurement) {
  expect_goes_on_after({measured_ - epoch_, measured_ - 1, 1000}, config_);
}

TEST_F(GrowthRun, GivesTheSameBitsForAnyNumberOfThreads) {
  Config edges = run_of("improved_gs");
  edges.train.iterations = 90;
  for (const Config& config : {busy_run(), edges}) expect_same_bits_on_any_threads(config);
}

TEST_F(GrowthRun, AddsGaussiansInTheRegionOfTheSettingAlone) {
  Config config = run_of("taming");
  const auto count_with = [&](const std::string& region) {
    config.density.region = region;
    return trained(config).count();
  };
  EXPECT_LE(count_with("0,1,0,1000"), scene_.points.size());  // it holds nothing of the scene
  EXPECT_GT(count_with("0,1,0,-1000"), scene_.points.size());
}

TEST_F(GrowthRun, TakesTheRegionInTheCoordinatesOfThePhotos) {
  Scene far = scene_;
  far.world_offset = {0.0, 5e6, 0.0};
  Config config = run_of("taming");
  config.density.region = "0,1,0,4999000";
  Trainer trainer(far, config, *backend_);
  trainer.run();
  EXPECT_GT(trainer.model().count(), far.points.size());
}

}  // namespace
}  // namespace gs
