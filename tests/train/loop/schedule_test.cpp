// SPDX-License-Identifier: Apache-2.0
// The standard schedule of 30,000 steps, number by number (Kerbl et al. 2023; Faster-GS), and a
// schedule of twice its length.
#include "gs_train/schedule.h"

#include "tests/support/adaptive.h"
#include "tests/support/test.h"

namespace gs {
namespace {

/// The steps of a run at which something happens.
template <class Happens>
std::vector<int> steps_where(const Schedule& schedule, Happens&& happens) {
  std::vector<int> steps;
  for (int step = 1; step <= schedule.steps(); ++step)
    if (std::invoke(happens, schedule, step)) steps.push_back(step);
  return steps;
}
std::vector<int> from_to_every(int from, int to, int every) {
  std::vector<int> steps;
  for (int step = from; step <= to; step += every) steps.push_back(step);
  return steps;
}

class StandardSchedule : public ::testing::Test {
 protected:
  const Schedule schedule_{adaptive_config(), 2.0f};
};

TEST_F(StandardSchedule, Has30000Steps) { EXPECT_EQ(schedule_.steps(), 30'000); }

TEST_F(StandardSchedule, RefinesEvery100thStepFrom600To14900) {
  EXPECT_EQ(steps_where(schedule_, &Schedule::refine), from_to_every(600, 14'900, 100));
}

TEST_F(StandardSchedule, ResetsOpacitiesFourTimes) {
  EXPECT_THAT(steps_where(schedule_, &Schedule::reset_opacity),
              ElementsAre(3000, 6000, 9000, 12'000));
}

TEST_F(StandardSchedule, ResetsOpacitiesOnceMoreOnWhite) {
  Config config = adaptive_config();
  config.render.background = Background::white;
  const Schedule schedule(config, 2.0f);
  EXPECT_THAT(steps_where(schedule, &Schedule::reset_opacity),
              ElementsAre(500, 3000, 6000, 9000, 12'000));
}

TEST_F(StandardSchedule, ComparesSurfacesInEverySecondUpdate) {
  Config config = adaptive_config();
  config.surface = {.normal_weight = 1, .photo_weight = 3, .from_step = 29'990};
  const auto compares = [](const Schedule& schedule, int step) {
    const SurfaceWeights weights = schedule.surface_weights(step);
    EXPECT_TRUE(!weights.any() || (weights.normal == 2 && weights.photo == 6));
    return weights.any();
  };
  EXPECT_EQ(steps_where(Schedule(config, 2.0f), compares), from_to_every(29'990, 30'000, 2));
  config.train.batch = 3;  // updates end at 29,991, 29,994, 29,997 and 30,000
  EXPECT_THAT(steps_where(Schedule(config, 2.0f), compares),
              ElementsAre(29'992, 29'993, 29'994, 29'998, 29'999, 30'000));
}

// The trainer stops at the degree of the config, so later steps do not count.
TEST_F(StandardSchedule, RaisesTheShDegreeAt1000And2000And3000) {
  std::vector<int> steps = steps_where(schedule_, &Schedule::raise_sh_degree);
  steps.resize(3);
  EXPECT_THAT(steps, ElementsAre(1000, 2000, 3000));
}

TEST_F(StandardSchedule, SortsAlongTheMortonCurveThreeTimes) {
  EXPECT_THAT(steps_where(schedule_, &Schedule::reorder), ElementsAre(5000, 10'000, 15'000));
}

TEST_F(StandardSchedule, GathersStatisticsAsLongAsTheyAreUsed) {
  EXPECT_EQ(steps_where(schedule_, &Schedule::gather_statistics), from_to_every(1, 14'900, 1));
}

TEST_F(StandardSchedule, DropsHugeGaussiansOnlyAfterTheFirstReset) {
  EXPECT_FALSE(schedule_.prune_large(3000));
  EXPECT_TRUE(schedule_.prune_large(3100));
}

// 1.6e-4 * 2 -> 1.6e-6 * 2, a hundredth over the run, by the same factor each step.
TEST_F(StandardSchedule, PositionRateFallsToAHundredthExponentially) {
  const auto rate = [&](int step) { return double(schedule_.learning_rates(step).mean); };
  EXPECT_NEAR(rate(1) / (3.2e-4 * std::pow(0.01, 1.0 / 30'000)), 1, 1e-6);
  EXPECT_NEAR(rate(15'000) / 3.2e-5, 1, 1e-6);
  EXPECT_NEAR(rate(30'000) / 3.2e-6, 1, 1e-6);
}

TEST_F(StandardSchedule, KeepsTheOtherRates) {
  for (const int step : {1, 15'000, 30'000}) {
    const LearningRates rates = schedule_.learning_rates(step);
    EXPECT_EQ(rates.log_scale, 5e-3f);
    EXPECT_EQ(rates.rotation, 1e-3f);
    EXPECT_EQ(rates.logit_opacity, 0.025f);
    EXPECT_EQ(rates.sh0, 2.5e-3f);
    EXPECT_EQ(rates.sh_rest, 1.25e-4f);
  }
}

TEST(ScheduleOfTwiceTheSteps, DoublesEveryPointInTime) {
  Config config = adaptive_config();
  config.train.steps_scaler = 2;
  const Schedule schedule(config, 2.0f);
  EXPECT_EQ(schedule.steps(), 60'000);
  EXPECT_EQ(steps_where(schedule, &Schedule::refine), from_to_every(1200, 29'800, 200));
  EXPECT_THAT(steps_where(schedule, &Schedule::reset_opacity),
              ElementsAre(6000, 12'000, 18'000, 24'000));
  EXPECT_THAT(steps_where(schedule, &Schedule::reorder), ElementsAre(10'000, 20'000, 30'000));
  EXPECT_TRUE(schedule.raise_sh_degree(2000));
  EXPECT_FALSE(schedule.raise_sh_degree(1000));
  EXPECT_NEAR(schedule.learning_rates(60'000).mean / 3.2e-6, 1, 1e-6);
}

TEST(ScheduleOfEpochs, RefinesAfterSoManyPassesOverThePhotos) {
  Config config = adaptive_config();
  config.density.strategy = "litegs";  // every second epoch
  const Schedule schedule(config, 2.0f, 250), few(config, 2.0f, 40), unknown(config, 2.0f);
  EXPECT_EQ(steps_where(schedule, &Schedule::refine), from_to_every(1000, 14'500, 500));
  EXPECT_EQ(steps_where(few, &Schedule::refine), from_to_every(600, 14'900, 100));
  EXPECT_EQ(steps_where(unknown, &Schedule::refine), from_to_every(600, 14'900, 100));
}

TEST(ScheduleOfEpochs, RefinesTenTimesHoweverManyPhotosThereAre) {
  Config config = adaptive_config();
  config.density.strategy = "litegs";           // every second epoch
  const Schedule schedule(config, 2.0f, 5000);  // 10,000 steps, of which the window has 14,300
  EXPECT_EQ(steps_where(schedule, &Schedule::refine), from_to_every(1430, 14'300, 1430));
}

TEST(ScheduleOfAShortRun, MayKeepThePositionRateAtFirst) {
  Config config = adaptive_config();
  config.train.iterations = 10'000;
  config.density.strategy = "dash_gaussian";
  config.train.resolution_ramp = {2, 2};  // up to step 4,000
  config.train.resolution_every = 6'000;
  const Schedule schedule(config, 2.0f);
  EXPECT_NEAR(schedule.learning_rates(1).mean / 3.2e-4, 1, 1e-6);
  EXPECT_NEAR(schedule.learning_rates(4000).mean / 3.2e-4, 1, 1e-6);
  EXPECT_NEAR(schedule.learning_rates(7000).mean / 3.2e-5, 1, 1e-6);
  EXPECT_NEAR(schedule.learning_rates(10'000).mean / 3.2e-6, 1, 1e-6);
}

TEST(ScheduleOfLearningRates, FallsInACooldown) {
  Config config = adaptive_config();
  config.train.iterations = 10'000;
  const Schedule constant(config, 2.0f);
  config.optimizer.cooldown_from = 24'000;  // step 8,000
  config.optimizer.cooldown_share = 0.01f;
  const Schedule schedule(config, 2.0f);
  const auto share = [&](int step, float LearningRates::*rate) {
    return double(schedule.learning_rates(step).*rate) /
           double(constant.learning_rates(step).*rate);
  };
  for (const auto rate :
       {&LearningRates::mean, &LearningRates::log_scale, &LearningRates::rotation,
        &LearningRates::logit_opacity, &LearningRates::sh0, &LearningRates::sh_rest}) {
    EXPECT_EQ(share(1, rate), 1);
    EXPECT_EQ(share(8000, rate), 1);
    EXPECT_NEAR(share(9000, rate), 0.1, 1e-6);
    EXPECT_NEAR(share(10'000, rate), 0.01, 1e-7);
    EXPECT_NEAR(share(10'500, rate), 0.01, 1e-7);  // train.extra_steps
  }
}

TEST(ScheduleOfPhotoSizes, HasEachFactorForItsTime) {
  Config config = adaptive_config();
  config.train.iterations = 10'000;
  config.train.resolution_ramp = {4, 2};
  const Schedule schedule(config, 2.0f);
  Camera camera;
  camera.width = 4000, camera.height = 3000;
  const auto factor = [&](int step) { return schedule.photo_reduction(step, camera); };
  EXPECT_EQ(factor(1), 4);
  EXPECT_EQ(factor(2000), 4);
  EXPECT_EQ(factor(2001), 2);
  EXPECT_EQ(factor(4000), 2);
  EXPECT_EQ(factor(4001), 1);
  EXPECT_EQ(factor(10'000), 1);
  EXPECT_EQ(Schedule(adaptive_config(), 2.0f).photo_reduction(1, camera), 1);
}

// 100,000 pixels at least: 1,000 x 750 may be reduced twice, not three times.
TEST(ScheduleOfPhotoSizes, ReducesNoPhotoTooFar) {
  Config config = adaptive_config();
  config.train.resolution_ramp = {8};
  const Schedule schedule(config, 2.0f);
  Camera camera;
  camera.width = 1000, camera.height = 750;
  EXPECT_EQ(schedule.photo_reduction(1, camera), 2);
  camera.width = 400;
  EXPECT_EQ(schedule.photo_reduction(1, camera), 1);
  camera.width = 5, camera.height = 3;
  config.train.resolution_least = 1;
  EXPECT_EQ(Schedule(config, 2.0f).photo_reduction(1, camera), 3);
}

TEST(ScheduleOfAdam, HasTheRuleOfTheBatch) {
  Config config = adaptive_config();
  EXPECT_EQ(Schedule(config, 1).adam_rule(4).steps, 4);
  EXPECT_EQ(Schedule(config, 1).adam_rule(4).beta2, batch_rule(4).beta2);
  config.train.batch_rates = false;
  EXPECT_EQ(Schedule(config, 1).adam_rule(4).steps, 1);
  EXPECT_EQ(Schedule(config, 1).adam_rule(4).beta2, AdamRule().beta2);
}

TEST(GrowthShare, GoesFromZeroToOneOverTheRefinements) {
  Config config = adaptive_config();
  config.density.every = 300;
  const Schedule schedule(config, 2.0f);  // refines from 600 to 14,700
  EXPECT_EQ(schedule.growth_share(300), 0.0);
  EXPECT_EQ(schedule.growth_share(600), 0.0);
  EXPECT_NEAR(schedule.growth_share(7650), 0.5, 1e-9);
  EXPECT_EQ(schedule.growth_share(14'700), 1.0);
  EXPECT_EQ(schedule.growth_share(20'000), 1.0);
}

TEST(HasSeenAllViews, NeedsAnEpochSinceTheLastRefinement) {
  const Schedule few(adaptive_config(), 2.0f, 100), many(adaptive_config(), 2.0f, 500),
      unknown(adaptive_config(), 2.0f);
  EXPECT_TRUE(few.has_seen_all_views(600));
  EXPECT_TRUE(few.has_seen_all_views(700));
  EXPECT_TRUE(many.has_seen_all_views(600));  // the first refinement looks at all steps so far
  EXPECT_FALSE(many.has_seen_all_views(700));
  EXPECT_FALSE(unknown.has_seen_all_views(600));
}

// 100 steps hold a whole epoch of 51 photos only where one of its ends is near theirs.
TEST(HasSeenAllViews, NeedsAWholeEpoch) {
  const Schedule schedule(adaptive_config(), 2.0f, 51);
  EXPECT_TRUE(schedule.has_seen_all_views(900));    // 817 to 867
  EXPECT_FALSE(schedule.has_seen_all_views(2600));  // 2500 to 2550: step 2500 is not in it
}

// ---- statistics of the last epoch --------------------------------------------------------------

Config with_epochs(int every) {
  Config config = adaptive_config();
  config.density.strategy = "growth";  // its statistics are of an epoch
  config.density.every = every;
  return config;
}

TEST(StatisticsOfAnEpoch, AreGatheredInTheLastWholeOneBeforeARefinement) {
  const Schedule schedule(with_epochs(300), 2.0f, 80);  // epochs end at 560, 880, 1200
  const auto gathers = [&](int from, int to) {
    std::vector<int> steps;
    for (int step = from; step <= to; ++step)
      if (schedule.gather_statistics(step)) steps.push_back(step);
    return steps;
  };
  EXPECT_EQ(gathers(1, 600), from_to_every(481, 560, 1));
  EXPECT_EQ(gathers(601, 900), from_to_every(801, 880, 1));
  EXPECT_EQ(gathers(901, 1200), from_to_every(1121, 1200, 1));
  EXPECT_TRUE(gathers(14'701, 30'000).empty());  // after the last refinement
  EXPECT_TRUE(schedule.has_seen_all_views(900));
}

TEST(StatisticsOfAnEpoch, AreOfAllStepsWhereNoneLiesBetweenTwoRefinements) {
  const Schedule schedule(with_epochs(100), 2.0f, 250), unknown(with_epochs(100), 2.0f);
  for (int step = 601; step <= 14'900; ++step) {
    ASSERT_TRUE(schedule.gather_statistics(step)) << step;
    ASSERT_TRUE(unknown.gather_statistics(step)) << step;
  }
  EXPECT_FALSE(schedule.gather_statistics(250));  // of the first refinement only 251 to 500 count
  EXPECT_TRUE(schedule.gather_statistics(251));
}

// ---- shares that are pruned --------------------------------------------------------------------

Config with_method(const std::string& strategy) {
  Config config = adaptive_config();
  config.density.strategy = strategy;
  return config;
}

TEST(RecoveryPrune, ComesSoManyStepsAfterTheFirstResetsInsteadOfARefinement) {
  Config config = with_method("improved_gs");
  const Schedule schedule(config, 2.0f);
  EXPECT_THAT(steps_where(schedule, &Schedule::recovery_prune), ElementsAre(3300, 6300));
  EXPECT_FLOAT_EQ(float(schedule.recovery_prune(3300)), 0.2f);
  EXPECT_FALSE(schedule.refine(3300));
  EXPECT_TRUE(schedule.refine(3200) && schedule.refine(3400));
  config.train.iterations =
      7000;  // resets after 1,000 and 2,000 steps; the last one scales to 1,400
  const Schedule shorter(config, 2.0f);
  EXPECT_THAT(steps_where(shorter, &Schedule::recovery_prune), ElementsAre(1300));
  config.density.strategy = "adaptive";
  EXPECT_EQ(Schedule(config, 2.0f).recovery_prune(3300), 0.0);
  EXPECT_TRUE(Schedule(config, 2.0f).refine(3300));
}

TEST(SensitivityPrune, IsSoftBeforeTheLastRefinementAndHardAfterwards) {
  const Schedule schedule(with_method("speedy_splat"), 2.0f, 200);
  EXPECT_THAT(steps_where(schedule, &Schedule::sensitivity_prune),
              ElementsAre(6000, 9000, 12'000, 15'000, 18'000, 21'000, 24'000, 27'000));
  for (const int step : {6000, 9000, 12'000})
    EXPECT_FLOAT_EQ(float(schedule.sensitivity_prune(step)), 0.8f);
  for (const int step : {15'000, 27'000})
    EXPECT_FLOAT_EQ(float(schedule.sensitivity_prune(step)), 0.3f);
}

TEST(SensitivityPrune, IsMeasuredInTheLastWholeEpochWithoutRefinements) {
  const Schedule schedule(with_method("speedy_splat"), 2.0f, 280);  // an epoch ends at 5880
  EXPECT_EQ(
      steps_where(schedule, [](const Schedule& s,
                               int step) { return step < 8000 && s.measure_sensitivity(step); }),
      from_to_every(5601, 5880, 1));
  EXPECT_TRUE(schedule.refine(5600));
  for (int step = 5601; step <= 6000; ++step) EXPECT_FALSE(schedule.refine(step)) << step;
  EXPECT_TRUE(schedule.refine(6100));
  EXPECT_TRUE(schedule.measure_sensitivity(17'800));
  EXPECT_TRUE(schedule.gather_statistics(17'800));
  EXPECT_FALSE(schedule.gather_statistics(16'500));
}

TEST(SensitivityPrune, NeedsAnEpochSinceTheOneBefore) {
  const Schedule many(with_method("speedy_splat"), 2.0f, 3100),
      unknown(with_method("speedy_splat"), 2.0f);
  for (int step = 1; step <= 30'000; ++step) {
    ASSERT_EQ(many.sensitivity_prune(step), 0.0) << step;
    ASSERT_EQ(unknown.sensitivity_prune(step), 0.0) << step;
  }
  EXPECT_TRUE(many.refine(6000));
}

TEST(LatePrune, ComesAtTheIntervalsOfResetsAfterTheRefinements) {
  const Schedule none(adaptive_config(), 2.0f), schedule(with_method("fastgs"), 2.0f);
  EXPECT_TRUE(steps_where(none, &Schedule::prune_late).empty());
  EXPECT_THAT(steps_where(schedule, &Schedule::prune_late),
              ElementsAre(18'000, 21'000, 24'000, 27'000));
}

TEST(PoseRate, WarmsUpFallsToAHundredthAndRestsAfterResets) {
  Config config = adaptive_config();
  EXPECT_EQ(Schedule(config, 1).pose_rate(15001), 0);  // poses are not refined
  config.poses.refine = true;
  config.poses.rate = 1e-3f;
  const Schedule schedule(config, 1);
  EXPECT_LT(schedule.pose_rate(1), 2e-6f);
  EXPECT_NEAR(schedule.pose_rate(500), 5e-4, 1e-4);
  EXPECT_NEAR(schedule.pose_rate(1000), 1e-3, 2e-4);
  EXPECT_NEAR(schedule.pose_rate(30000), 1e-5, 1e-9);
  for (const int step : {3001, 3500, 4000, 12001}) EXPECT_EQ(schedule.pose_rate(step), 0);
  for (const int step : {3000, 4001, 15001}) EXPECT_GT(schedule.pose_rate(step), 0) << step;
  config.train.iterations = 3000;
  EXPECT_NEAR(Schedule(config, 1).pose_rate(50), 5e-4, 1e-4);  // the warm-up is scaled
}

TEST(PhotometricRate, WarmsUpFallsToAHundredthAndRestsAfterResets) {
  Config config = adaptive_config();
  config.photometric.rate = 1e-3f;
  const Schedule schedule(config, 1);
  EXPECT_LT(schedule.photometric_rate(1), 2e-5f);
  EXPECT_NEAR(schedule.photometric_rate(500), 1e-3, 1e-4);
  EXPECT_NEAR(schedule.photometric_rate(30000), 1e-5, 1e-9);
  for (const int step : {3001, 3500, 4000, 12001}) EXPECT_EQ(schedule.photometric_rate(step), 0);
  for (const int step : {3000, 4001, 15001}) EXPECT_GT(schedule.photometric_rate(step), 0) << step;
  config.density.strategy = "mcmc";  // lowers no opacities
  EXPECT_GT(Schedule(config, 1).photometric_rate(3001), 0);
}

}  // namespace
}  // namespace gs
