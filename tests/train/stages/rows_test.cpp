// SPDX-License-Identifier: Apache-2.0
// Stage 9: clone, split, prune, cap and opacity reset, on hand-made statistics.
#include "gs_train/stages/scalar_stages.h"
#include "tests/support/models.h"

namespace gs {
namespace {

constexpr float kSmall = 0.01f, kLarge = 0.5f;  // scales on both sides of small_scale
constexpr float kInfinity = std::numeric_limits<float>::infinity();
constexpr std::uint64_t kSeed = 1;
const AdaptiveRules kRules{.gradient_threshold = 1,
                           .small_scale = 0.1f,
                           .prune_opacity = 0.05f,
                           .prune_scale = kInfinity,
                           .max_gaussians = 0};

/// One row: its scale, its mean gradient over four visits, its opacity.
struct Row {
  float scale, gradient, opacity = 0.5f;
};
constexpr Row kStays{kSmall, 0.5f}, kClones{kSmall, 2}, kSplits{kLarge, 2};
constexpr Row kFaint{kSmall, 0.5f, 0.01f};

/// Row i lies at x = i, and its moments are i + 1 everywhere.
TrainingModel model_with(const std::vector<Row>& rows) {
  Gaussians gaussians(rows.size(), host_memory());
  for (std::size_t i = 0; i < rows.size(); ++i) {
    set_gaussian(gaussians, i, {float(i), 0, 0}, rows[i].scale, rows[i].opacity);
    gaussians.sh_rest[i].coefficient[4] = Vec3f(float(i));
  }
  TrainingModel model = model_of(gaussians);
  number_moments(model, 1);
  for (std::size_t i = 0; i < rows.size(); ++i) {
    model.statistics.visits[i] = 4;
    model.statistics.gradient_norm[i] = 4 * rows[i].gradient;
  }
  return model;
}

RefineReport refine(TrainingModel& model, const AdaptiveRules& rules = kRules, int step = 600) {
  return make_scalar_row_ops()->grow(model, GrowthRules{rules}, kSeed, step);
}

/// The row that each row of a model came from, as stored in one of its SH coefficients.
std::vector<int> origins(const TrainingModel& model) {
  std::vector<int> result;
  for (const ShRest& row : model.gaussians.sh_rest) result.push_back(int(row.coefficient[4].x));
  return result;
}

TEST(Refine, KeepsSurvivorsInOrderThenClonesThenHalves) {
  TrainingModel model = model_with({kStays, kSplits, kClones, kFaint, kStays, kClones, kSplits});
  const RefineReport report = refine(model);
  EXPECT_THAT(origins(model), ElementsAre(0, 2, 4, 5, 2, 5, 1, 1, 6, 6));
  EXPECT_EQ(report.cloned, 2u);
  EXPECT_EQ(report.split, 2u);
  EXPECT_EQ(report.pruned, 1u);
}

TEST(Refine, RowsOutsideOfTheRegionDoNotGrowAndArePrunedAsOthers) {
  TrainingModel model = model_with({kClones, kSplits, kFaint, kClones, kSplits, kFaint});
  AdaptiveRules rules = kRules;
  rules.region.half_spaces[0] = {{1, 0, 0}, 3};  // rows 3 to 5
  rules.region.count = 1;
  const RefineReport report = refine(model, rules);
  EXPECT_THAT(origins(model), ElementsAre(0, 1, 3, 3, 4, 4));
  EXPECT_EQ(report.pruned, 2u);
}

TEST(Refine, KeepsTheMomentsOfSurvivorsAndStartsNewRowsAtZero) {
  TrainingModel model = model_with({kStays, kSplits, kClones, kFaint, kStays});
  refine(model);
  const float expected[] = {1, 3, 5, 0, 0, 0};  // survivors 0, 2, 4; a clone; two halves
  ASSERT_EQ(model.count(), 6u);
  for (std::size_t i = 0; i < 6; ++i) EXPECT_TRUE(moments_are(model, i, expected[i])) << i;
}

TEST(Refine, LeavesSurvivorsAsTheyAreAndClonesEqualToThem) {
  TrainingModel model = model_with({kStays, kClones});
  const TrainingModel before = model_with({kStays, kClones, kClones});
  refine(model);
  Gaussians expected = copy_of(before.gaussians);
  expected.mean[2].x = 1;  // the clone of row 1
  expected.sh_rest[2] = expected.sh_rest[1];
  EXPECT_TRUE(same_bits(model.gaussians, expected));
}

TEST(Refine, ClearsTheStatisticsOfAllRows) {
  TrainingModel model = model_with({kStays, kSplits, kClones});
  refine(model);
  EXPECT_EQ(model.statistics.visits.download(), std::vector<float>(5));
  EXPECT_EQ(model.statistics.gradient_norm.download(), std::vector<float>(5));
}

TEST(Refine, ShrinksHalvesBy1Point6AndKeepsTheRestOfTheirParent) {
  TrainingModel model = model_with({kSplits});
  const Quatf rotation{0.8f, 0.3f, -0.5f, 0.2f};
  model.gaussians.rotation[0] = rotation;
  const TrainingModel before = model_of(model.gaussians);
  refine(model);
  ASSERT_EQ(model.count(), 2u);
  for (std::size_t i = 0; i < 2; ++i) {
    EXPECT_NEAR(std::exp(model.gaussians.log_scale[i].y), kLarge / 1.6f, 1e-6f);
    EXPECT_EQ(model.gaussians.logit_opacity[i], before.gaussians.logit_opacity[0]);
    EXPECT_EQ(model.gaussians.sh0[i], before.gaussians.sh0[0]);
    EXPECT_EQ(model.gaussians.rotation[i].y, rotation.y);
  }
  EXPECT_NE(model.gaussians.mean[0], model.gaussians.mean[1]);
}

// Scales of (2, 0.5, 0.1): the standard deviations of 4000 draws have standard errors of 1.1
// percent.
TEST(Refine, DrawsHalvesFromTheirParent) {
  std::vector<Row> rows(2000, kSplits);
  TrainingModel model = model_with(rows);
  for (std::size_t i = 0; i < rows.size(); ++i) {
    model.gaussians.mean[i] = {1, 2, 3};
    model.gaussians.log_scale[i] = {std::log(2.0f), std::log(0.5f), std::log(0.1f)};
  }
  refine(model);
  ASSERT_EQ(model.count(), 4000u);
  Vec3d mean(0.0), square(0.0);
  for (const Vec3f& m : model.gaussians.mean) {
    mean += Vec3d(m) / 4000.0;
    const Vec3d offset = Vec3d(m) - Vec3d(1.0, 2.0, 3.0);
    square += offset * offset / 4000.0;
  }
  EXPECT_NEAR(mean.x, 1, 0.13);  // four standard errors of 2 / sqrt(4000)
  EXPECT_NEAR(mean.y, 2, 0.032);
  EXPECT_NEAR(std::sqrt(square.x), 2, 0.1);
  EXPECT_NEAR(std::sqrt(square.y), 0.5, 0.025);
  EXPECT_NEAR(std::sqrt(square.z), 0.1, 0.005);
}

TEST(Refine, DrawsTheSameHalvesForTheSameSeedAndStep) {
  const std::vector<Row> rows(100, kSplits);
  TrainingModel a = model_with(rows), b = model_with(rows), later = model_with(rows),
                reseeded = model_with(rows);
  refine(a);
  with_threads(1, [&] { return refine(b); });
  refine(later, kRules, 700);
  make_scalar_row_ops()->grow(reseeded, GrowthRules{kRules}, 2, 600);
  EXPECT_TRUE(same_bits(a, b));
  EXPECT_FALSE(same_bits(a.gaussians.mean, later.gaussians.mean));
  EXPECT_FALSE(same_bits(a.gaussians.mean, reseeded.gaussians.mean));
}

TEST(Refine, PrunesAFaintRowAndNeitherClonesNorSplitsIt) {
  TrainingModel model = model_with({{kSmall, 2, 0.01f}, kStays, {kLarge, 2, 0.01f}});
  const RefineReport report = refine(model);
  EXPECT_THAT(origins(model), ElementsAre(1));
  EXPECT_EQ(report.cloned, 0u);
}

TEST(Refine, PrunesHugeRowsUnlessTheirHalvesAreSmallEnough) {
  AdaptiveRules rules = kRules;
  rules.prune_scale = 1;
  TrainingModel model = model_with({{1.5f, 0.5f}, {1.5f, 2}, {1.7f, 2}, kStays});
  refine(model, rules);
  EXPECT_THAT(origins(model), ElementsAre(3, 1, 1));  // 1.5 / 1.6 < 1 < 1.7 / 1.6
}

TEST(Refine, PrunesRowsWithoutARotation) {
  TrainingModel model = model_with({kStays, kStays, kClones, kSplits});
  for (const std::size_t i : {0, 2, 3}) model.gaussians.rotation[i] = {1e-5f, 0, 0, 0};
  refine(model);
  EXPECT_THAT(origins(model), ElementsAre(1));
}

TEST(Refine, DoesNothingToRowsThatWereNeverSeen) {
  TrainingModel model = model_with({kSplits, kClones});
  model.statistics.visits.fill_zero();
  model.statistics.gradient_norm.fill_zero();
  const TrainingModel before = model_of(model.gaussians);
  refine(model);
  EXPECT_TRUE(same_bits(model.gaussians, before.gaussians));
}

TEST(Refine, GrowsOnlyTheRowsOfLargestMeanGradientUpToTheCap) {
  AdaptiveRules rules = kRules;
  rules.max_gaussians = 7;
  TrainingModel model = model_with({{kSmall, 2}, {kLarge, 5}, kStays, {kSmall, 4}, {kLarge, 3}});
  // Row 0 has the largest sum, but over many more visits.
  model.statistics.visits[0] = 400;
  model.statistics.gradient_norm[0] = 800;
  const RefineReport report = refine(model, rules);
  EXPECT_THAT(origins(model), ElementsAre(0, 2, 3, 4, 3, 1, 1));
  EXPECT_EQ(report.cloned, 1u);
  EXPECT_EQ(report.split, 1u);
}

TEST(Refine, StaysBelowTheCapForAnyMixtureOfRows) {
  Draws draws(3);
  for (int round = 0; round < 50; ++round) {
    std::vector<Row> rows(40);
    for (Row& row : rows)
      row = {draws.chance(0.5f) ? kSmall : kLarge, draws.uniform(0, 3), draws.uniform(0.01f, 0.2f)};
    AdaptiveRules rules = kRules;
    rules.max_gaussians = 30 + std::int64_t(draws.below(60));
    TrainingModel model = model_with(rows);
    refine(model, rules);
    EXPECT_LE(model.count(), std::size_t(std::max<std::int64_t>(rules.max_gaussians, 40)));
  }
}

TEST(Refine, AtTheCapStillPrunesWhatWouldHaveSplit) {
  AdaptiveRules rules = kRules;
  rules.max_gaussians = 2;
  rules.prune_scale = 1;
  TrainingModel model = model_with({{1.5f, 2}, kStays, kStays, {kLarge, 2, 0.01f}});
  const RefineReport report = refine(model, rules);
  EXPECT_THAT(origins(model), ElementsAre(1, 2));
  EXPECT_EQ(report.pruned, 2u);
}

TEST(Refine, MayPruneEverythingAndTakesAModelWithoutRows) {
  TrainingModel model = model_with({kFaint, kFaint});
  EXPECT_EQ(refine(model).pruned, 2u);
  EXPECT_EQ(model.count(), 0u);
  EXPECT_EQ(refine(model).pruned, 0u);
}

TEST(ResetOpacity, LowersWhatIsAboveAndLeavesWhatIsBelow) {
  TrainingModel model = model_with({kStays, {kSmall, 0, 0.004f}});
  const float below = model.gaussians.logit_opacity[1];
  make_scalar_row_ops()->reset_opacity(model, 0.01f);
  EXPECT_NEAR(model.gaussians.logit_opacity[0], -4.595119953f, 1e-6f);
  EXPECT_EQ(model.gaussians.logit_opacity[1], below);
}

TEST(ResetOpacity, ClearsTheMomentsOfTheOpacitiesAndNoOthers) {
  TrainingModel model = model_with({kStays, kStays});
  make_scalar_row_ops()->reset_opacity(model, 0.01f);
  const auto& moments = float_moments(model);
  for (std::uint32_t i = 0; i < 2; ++i) {
    EXPECT_TRUE(moments_are(moments.logit_opacity, i, 0));
    EXPECT_TRUE(moments_are(moments.mean, i, i + 1));
    EXPECT_TRUE(moments_are(moments.sh_rest, i, i + 1));
  }
}

TEST(PruneShare, RemovesTheFaintestWholeAndInOrder) {
  TrainingModel model = model_with({{kSmall, 0, 0.5f},
                                    {kSmall, 0, 0.2f},
                                    {kSmall, 0, 0.4f},
                                    {kSmall, 0, 0.2f},
                                    {kSmall, 0, 0.9f}});
  EXPECT_EQ(make_scalar_row_ops()->prune_share(model, PruneOrder::opacity, 0.5), 2u);
  ASSERT_EQ(model.count(), 3u);
  for (std::uint32_t i = 0; i < 3; ++i) EXPECT_TRUE(moments_are(model, i, 2 * i + 1)) << i;
}

TEST(PruneShare, TakesTheFirstOfEqualRowsAndBrokenOnesBeforeAll) {
  TrainingModel model = model_with({kStays, kStays, kStays, kStays});
  model.gaussians.logit_opacity[2] = std::numeric_limits<float>::quiet_NaN();
  EXPECT_EQ(make_scalar_row_ops()->prune_share(model, PruneOrder::opacity, 0.5), 2u);
  EXPECT_TRUE(moments_are(model, 0, 2));
  EXPECT_TRUE(moments_are(model, 1, 4));
}

TEST(PruneShare, BySensitivityTakesTheSumOfSquares) {
  TrainingModel model = model_with({kStays, kStays, kStays, kStays});
  EXPECT_THROW(make_scalar_row_ops()->prune_share(model, PruneOrder::sensitivity, 0.5),
               std::logic_error);
  begin_sums(model);
  for (std::size_t i = 0; i < 4; ++i) model.statistics.sums[i] = {0, float(i), 4 - float(i)};
  EXPECT_EQ(make_scalar_row_ops()->prune_share(model, PruneOrder::sensitivity, 0.25), 1u);
  ASSERT_EQ(model.count(), 3u);
  EXPECT_EQ(model.statistics.sums[2].second, 2.0f);  // statistics of the others stay
}

TEST(PruneShare, OfNothingAndWithoutRowsRemovesNothing) {
  TrainingModel model = model_with({kStays, kStays}), none = model_with({});
  EXPECT_EQ(make_scalar_row_ops()->prune_share(model, PruneOrder::opacity, 0.4), 0u);
  EXPECT_EQ(make_scalar_row_ops()->prune_share(none, PruneOrder::opacity, 0.4), 0u);
  EXPECT_EQ(model.count(), 2u);
}

TEST(Prune, RemovesFaintAndDegenerateRowsWholeAndInOrder) {
  TrainingModel model = model_with({kFaint, kStays, kStays, kFaint, kStays});
  model.gaussians.rotation[2] = {0, 0, 0, 0};
  EXPECT_EQ(make_scalar_row_ops()->prune(model, 0.05f), 3u);
  EXPECT_THAT(origins(model), ElementsAre(1, 4));
  EXPECT_TRUE(moments_are(model, 0, 2));
  EXPECT_TRUE(moments_are(model, 1, 5));
}

/// Rows 0 to 5 are not finite, each in another way; row 6 is valid.
TrainingModel model_with_broken_rows(const Row& row) {
  TrainingModel model = model_with(std::vector<Row>(7, row));
  const Gaussians& rows = model.gaussians;
  rows.logit_opacity[0] = kNan;
  rows.rotation[1].z = kNan;
  rows.mean[2].y = kNan;
  rows.mean[3].x = kInfinity;
  rows.log_scale[4].z = kNan;
  rows.log_scale[5].x = kInfinity;
  return model;
}

TEST(Prune, RemovesRowsThatAreNotFinite) {
  TrainingModel model = model_with_broken_rows(kStays);
  EXPECT_EQ(make_scalar_row_ops()->prune(model, 0.05f), 6u);
  EXPECT_THAT(origins(model), ElementsAre(6));
}

TEST(Refine, RemovesRowsThatAreNotFinite) {
  TrainingModel stays = model_with_broken_rows(kStays), clones = model_with_broken_rows(kClones),
                splits = model_with_broken_rows(kSplits);
  refine(stays);
  refine(clones);
  refine(splits);
  EXPECT_THAT(origins(stays), ElementsAre(6));
  EXPECT_THAT(origins(clones), ElementsAre(6, 6));
  EXPECT_THAT(origins(splits), ElementsAre(6, 6));
}

}  // namespace
}  // namespace gs
