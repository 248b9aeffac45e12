// SPDX-License-Identifier: Apache-2.0
// Stage 9 under the MCMC strategy: dead rows become copies of live ones, and copies are added up to
// a number.
#include "gs_train/stages/scalar_stages.h"
#include "tests/support/models.h"

namespace gs {
namespace {

constexpr float kDead = 0.001f;
constexpr RelocationRules kMoveOnly{0.005f, 0};

/// Row i lies at x = i, has this opacity, and moments of i + 1 everywhere.
TrainingModel model_with(const std::vector<float>& opacities) {
  Gaussians gaussians(opacities.size(), host_memory());
  for (std::size_t i = 0; i < opacities.size(); ++i) {
    set_gaussian(gaussians, i, {float(i), 0, 0}, 0.5f, opacities[i]);
    gaussians.sh_rest[i].coefficient[4] = Vec3f(float(i));
  }
  TrainingModel model = model_of(gaussians);
  const auto number = [](const char*, const auto& array) { number_rows(array, 1); };
  number_moments(model, 1);
  number("visits", model.statistics.visits);
  number("gradient_norm", model.statistics.gradient_norm);
  return model;
}

RefineReport relocate_rows(TrainingModel& model, const RelocationRules& rules,
                           std::uint64_t seed = 1, int step = 600) {
  return make_scalar_row_ops()->relocate(model, rules, seed, step);
}

/// The row that each row is a copy of, as stored in one of its SH coefficients.
std::vector<int> origins(const TrainingModel& model) {
  std::vector<int> result;
  for (const ShRest& row : model.gaussians.sh_rest) result.push_back(int(row.coefficient[4].x));
  return result;
}

double opacity(const TrainingModel& model, std::size_t i) {
  return sigmoid(double(model.gaussians.logit_opacity[i]));
}

TEST(Relocate, MovesDeadRowsOntoLiveOnesWhereTheyAre) {
  TrainingModel model = model_with({kDead, 0.5f, kDead, kDead});
  EXPECT_EQ(relocate_rows(model, kMoveOnly).moved, 3u);
  EXPECT_THAT(origins(model), ElementsAre(1, 1, 1, 1));
  for (const Vec3f& mean : model.gaussians.mean) EXPECT_EQ(mean, Vec3f(1, 0, 0));
}

TEST(Relocate, KeepsTheOpacityThatTheCopiesCoverTogether) {
  TrainingModel model = model_with({kDead, 0.8f, kDead});
  relocate_rows(model, kMoveOnly);
  double light = 1;
  for (std::size_t i = 0; i < 3; ++i) light *= 1 - opacity(model, i);
  EXPECT_NEAR(1 - light, 0.8, 1e-6);
  const double scale = shared_scale(0.8, shared_opacity(0.8, 3), 3);
  for (const Vec3f& log_scale : model.gaussians.log_scale)
    EXPECT_NEAR(std::exp(log_scale.y), 0.5 * scale, 1e-6);
}

TEST(Relocate, StartsMovedRowsAndTheirSourcesAtZeroMomentsAndLeavesTheOthers) {
  TrainingModel model = model_with({0.4f, kDead, 0.4f, 0.4f, 0.4f});
  const TrainingModel before = model_with({0.4f, kDead, 0.4f, 0.4f, 0.4f});
  relocate_rows(model, kMoveOnly);
  const int source = origins(model)[1];
  for (std::size_t i = 0; i < 5; ++i) {
    const bool is_new = i == 1 || int(i) == source;
    EXPECT_TRUE(moments_are(model, i, is_new ? 0.0f : float(i + 1))) << i;
    if (!is_new) {
      EXPECT_EQ(model.gaussians.logit_opacity[i], before.gaussians.logit_opacity[i]);
      EXPECT_EQ(model.gaussians.log_scale[i], before.gaussians.log_scale[i]);
    }
  }
  EXPECT_EQ(model.statistics.visits.download(), std::vector<float>(5));
  EXPECT_EQ(model.statistics.gradient_norm.download(), std::vector<float>(5));
}

TEST(Relocate, DrawsInProportionToOpacity) {
  std::vector<float> opacities{0.2f, 0.6f, 0.2f};
  opacities.resize(20003, kDead);
  TrainingModel model = model_with(opacities);
  relocate_rows(model, kMoveOnly);
  std::map<int, int> copies;
  for (const int origin : origins(model)) ++copies[origin];
  // Standard errors are 57 and 69.
  EXPECT_NEAR(copies[0], 4000, 230);
  EXPECT_NEAR(copies[1], 12000, 280);
  EXPECT_NEAR(copies[2], 4000, 230);
}

// Rows 1 and 2 have the smallest weight, and the others none: each draw is on a boundary of rows.
TEST(Relocate, ADrawOnTheBoundaryOfTwoRowsTakesTheLaterOne) {
  std::vector<float> opacities{1e-9f, 0x1p-24f, 0x1p-24f};
  opacities.resize(1003, 1e-9f);
  TrainingModel model = model_with(opacities);
  EXPECT_EQ(relocate_rows(model, {0.0f, 0}).moved, 1001u);
  std::map<int, int> copies;
  for (const int origin : origins(model)) ++copies[origin];
  EXPECT_EQ(copies[1] + copies[2], 1003);
  EXPECT_NEAR(copies[1], 501, 64);  // four standard errors
}

TEST(Relocate, CopiesRowsInTheRegionAlone) {
  std::vector<float> opacities{0.9f, 0.9f, 0.1f, 0.9f, 0.1f};
  opacities.resize(2005, kDead);
  TrainingModel model = model_with(opacities);
  RelocationRules rules{0.005f, 3000};
  rules.region.half_spaces[0] = {{1, 0, 0}, 2};
  rules.region.half_spaces[1] = {{-1, 0, 0}, -4};  // rows 2 to 4
  rules.region.count = 2;
  const RefineReport report = relocate_rows(model, rules);
  EXPECT_EQ(report.moved, 2000u);  // none of the live rows outside
  EXPECT_EQ(report.cloned, 995u);
  std::map<int, int> copies;
  for (const int origin : origins(model)) ++copies[origin];
  EXPECT_EQ(copies[0], 1);
  EXPECT_EQ(copies[1], 1);
  EXPECT_EQ(copies[2] + copies[3] + copies[4], 2998);
  EXPECT_GT(copies[3], 2000);
}

TEST(Relocate, AddsCopiesUpToTheCountBehindAllRows) {
  TrainingModel model = model_with({0.5f, 0.5f, 0.5f});
  const RefineReport report = relocate_rows(model, {0.005f, 8});
  EXPECT_EQ(report.cloned, 5u);
  EXPECT_EQ(report.moved, 0u);
  ASSERT_EQ(model.count(), 8u);
  for (int i = 0; i < 3; ++i) EXPECT_EQ(origins(model)[i], i);
  for (std::size_t i = 3; i < 8; ++i) {
    const std::size_t source = std::size_t(origins(model)[i]);
    EXPECT_LT(source, 3u);
    EXPECT_EQ(model.gaussians.mean[i], model.gaussians.mean[source]);
    EXPECT_EQ(model.gaussians.logit_opacity[i], model.gaussians.logit_opacity[source]);
    EXPECT_EQ(model.gaussians.log_scale[i], model.gaussians.log_scale[source]);
    EXPECT_TRUE(moments_are(model, i, 0));
    EXPECT_TRUE(moments_are(model, source, 0));
  }
  EXPECT_EQ(model.statistics.visits.download(), std::vector<float>(8));
}

TEST(Relocate, AddsNoneWhereThereAreEnough) {
  TrainingModel model = model_with({0.5f, 0.5f, 0.5f});
  const TrainingModel before = model_with({0.5f, 0.5f, 0.5f});
  EXPECT_EQ(relocate_rows(model, {0.005f, 2}).cloned, 0u);
  EXPECT_TRUE(same_bits(model, before));
}

TEST(Relocate, TakesBrokenRowsForDead) {
  TrainingModel model = model_with({0.5f, 0.5f, 0.5f, 0.5f, 0.5f});
  model.gaussians.mean[0].x = kNan;
  model.gaussians.rotation[1] = {0, 0, 0, 0};
  model.gaussians.logit_opacity[2] = kNan;
  model.gaussians.log_scale[3].y = std::numeric_limits<float>::infinity();
  EXPECT_EQ(relocate_rows(model, kMoveOnly).moved, 4u);
  EXPECT_THAT(origins(model), ElementsAre(4, 4, 4, 4, 4));
  for (const Vec3f& mean : model.gaussians.mean) EXPECT_TRUE(is_finite(mean));
}

TEST(Relocate, WithoutALiveRowDoesNothing) {
  for (const std::vector<float>& opacities : {std::vector<float>{}, {kDead}, {kDead, kDead}}) {
    TrainingModel model = model_with(opacities);
    const TrainingModel before = model_with(opacities);
    const RefineReport report = relocate_rows(model, {0.005f, 10});
    EXPECT_EQ(report.moved + report.cloned, 0u);
    EXPECT_TRUE(same_bits(model, before));
  }
}

TEST(Relocate, DrawsTheSameForTheSameSeedAndStepOnAnyNumberOfThreads) {
  std::vector<float> opacities;
  Draws draws(5);
  for (int i = 0; i < 3000; ++i) opacities.push_back(draws.log_uniform(0.001f, 0.99f));
  const auto relocated = [&](std::uint64_t seed, int step) {
    TrainingModel model = model_with(opacities);
    relocate_rows(model, {0.005f, 3150}, seed, step);
    return model;
  };
  const TrainingModel one = with_threads(1, [&] { return relocated(1, 600); });
  EXPECT_TRUE(same_bits(one, with_threads(4, [&] { return relocated(1, 600); })));
  EXPECT_NE(origins(one), origins(relocated(1, 700)));
  EXPECT_NE(origins(one), origins(relocated(2, 600)));
}

TEST(Replace, MakesRowsCopiesOfTheirSources) {
  TrainingModel model = model_with({0.2f, 0.5f, 0.3f, 0.4f}),
                drawn = model_with({kDead, 0.5f, kDead, kDead});
  const std::uint32_t dead[] = {0, 2, 3}, source[] = {1, 1, 1};
  make_scalar_row_ops()->replace(model, {dead, 3}, {source, 3}, 0.005f);
  relocate_rows(drawn, kMoveOnly);
  clear_columns(model, RowRole::statistic);
  EXPECT_TRUE(same_bits(model, drawn));
}

}  // namespace
}  // namespace gs
