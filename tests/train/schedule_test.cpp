// SPDX-License-Identifier: Apache-2.0
// The standard schedule of 30,000 steps, number by number (Kerbl et al. 2023; Faster-GS), and a
// schedule of twice its length.
#include "gs_train/schedule.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <cmath>

namespace gs {
namespace {

using ::testing::ElementsAre;

/// The steps of a run at which something happens.
template <class Happens>
std::vector<int> steps_where(const Schedule& schedule, Happens&& happens) {
  std::vector<int> steps;
  for (int step = 1; step <= schedule.steps(); ++step)
    if (happens(step)) steps.push_back(step);
  return steps;
}
std::vector<int> from_to_every(int from, int to, int every) {
  std::vector<int> steps;
  for (int step = from; step <= to; step += every) steps.push_back(step);
  return steps;
}

class StandardSchedule : public ::testing::Test {
 protected:
  const Schedule schedule_{Config{}, 2.0f};
};

TEST_F(StandardSchedule, Has30000Steps) { EXPECT_EQ(schedule_.steps(), 30'000); }

TEST_F(StandardSchedule, RefinesEvery100thStepFrom600To14900) {
  EXPECT_EQ(steps_where(schedule_, [&](int step) { return schedule_.refine(step); }),
            from_to_every(600, 14'900, 100));
}

TEST_F(StandardSchedule, ResetsOpacitiesFourTimes) {
  EXPECT_THAT(steps_where(schedule_, [&](int step) { return schedule_.reset_opacity(step); }),
              ElementsAre(3000, 6000, 9000, 12'000));
}

TEST_F(StandardSchedule, ResetsOpacitiesOnceMoreOnWhite) {
  Config config;
  config.render.background = Background::white;
  const Schedule schedule(config, 2.0f);
  EXPECT_THAT(steps_where(schedule, [&](int step) { return schedule.reset_opacity(step); }),
              ElementsAre(500, 3000, 6000, 9000, 12'000));
}

// The trainer stops at the degree of the config, so later steps do not count.
TEST_F(StandardSchedule, RaisesTheShDegreeAt1000And2000And3000) {
  std::vector<int> steps =
      steps_where(schedule_, [&](int step) { return schedule_.raise_sh_degree(step); });
  steps.resize(3);
  EXPECT_THAT(steps, ElementsAre(1000, 2000, 3000));
}

TEST_F(StandardSchedule, SortsAlongTheMortonCurveThreeTimes) {
  EXPECT_THAT(steps_where(schedule_, [&](int step) { return schedule_.reorder(step); }),
              ElementsAre(5000, 10'000, 15'000));
}

TEST_F(StandardSchedule, GathersStatisticsAsLongAsTheyAreUsed) {
  EXPECT_EQ(steps_where(schedule_, [&](int step) { return schedule_.gather_statistics(step); }),
            from_to_every(1, 14'900, 1));
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
  Config config;
  config.train.steps_scaler = 2;
  const Schedule schedule(config, 2.0f);
  EXPECT_EQ(schedule.steps(), 60'000);
  EXPECT_EQ(steps_where(schedule, [&](int step) { return schedule.refine(step); }),
            from_to_every(1200, 29'800, 200));
  EXPECT_THAT(steps_where(schedule, [&](int step) { return schedule.reset_opacity(step); }),
              ElementsAre(6000, 12'000, 18'000, 24'000));
  EXPECT_THAT(steps_where(schedule, [&](int step) { return schedule.reorder(step); }),
              ElementsAre(10'000, 20'000, 30'000));
  EXPECT_TRUE(schedule.raise_sh_degree(2000));
  EXPECT_FALSE(schedule.raise_sh_degree(1000));
  EXPECT_NEAR(schedule.learning_rates(60'000).mean / 3.2e-6, 1, 1e-6);
}

TEST(ScheduleOfEpochs, RefinesAfterSoManyPassesOverThePhotos) {
  Config config;
  config.density.every_epochs = 2;
  const Schedule schedule(config, 2.0f, 250), few(config, 2.0f, 40), unknown(config, 2.0f);
  EXPECT_EQ(steps_where(schedule, [&](int step) { return schedule.refine(step); }),
            from_to_every(1000, 14'500, 500));
  EXPECT_EQ(steps_where(few, [&](int step) { return few.refine(step); }),
            from_to_every(600, 14'900, 100));
  EXPECT_EQ(steps_where(unknown, [&](int step) { return unknown.refine(step); }),
            from_to_every(600, 14'900, 100));
}

TEST(GrowthShare, GoesFromZeroToOneOverTheRefinements) {
  Config config;
  config.density.every = 300;
  const Schedule schedule(config, 2.0f);  // refines from 600 to 14,700
  EXPECT_EQ(schedule.growth_share(300), 0.0);
  EXPECT_EQ(schedule.growth_share(600), 0.0);
  EXPECT_NEAR(schedule.growth_share(7650), 0.5, 1e-9);
  EXPECT_EQ(schedule.growth_share(14'700), 1.0);
  EXPECT_EQ(schedule.growth_share(20'000), 1.0);
}

TEST(HasSeenAllViews, NeedsAnEpochSinceTheLastRefinement) {
  const Schedule few(Config{}, 2.0f, 100), many(Config{}, 2.0f, 500), unknown(Config{}, 2.0f);
  EXPECT_TRUE(few.has_seen_all_views(600));
  EXPECT_TRUE(few.has_seen_all_views(700));
  EXPECT_TRUE(many.has_seen_all_views(600));  // the first refinement looks at all steps so far
  EXPECT_FALSE(many.has_seen_all_views(700));
  EXPECT_FALSE(unknown.has_seen_all_views(600));
}

}  // namespace
}  // namespace gs
