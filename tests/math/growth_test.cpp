// SPDX-License-Identifier: Apache-2.0
// The rules of growth, one Gaussian at a time: scores, children, opacities, counts.
#include "gs_core/math/density/growth.h"

#include "tests/support/test.h"

namespace gs {
namespace {

const Vec3f kLogScale{std::log(0.5f), std::log(2.0f), std::log(0.1f)};  // longest along y

FragmentSums forces(const std::vector<double>& f) {
  double first = 0, second = 0;
  for (const double one : f) first += one, second += one * one;
  return {float(f.size()), float(first), float(second)};
}

// n ((sum f^2) / (n + 1) - ((sum f) / (n + 1))^2), by hand.
TEST(ForceScore, IsTheSpreadOfTheForces) {
  EXPECT_NEAR(force_score(forces({1, -1, 1})), 3 * (3.0 / 4 - 1.0 / 16), 1e-12);
  EXPECT_NEAR(force_score(forces({2, 2})), 2 * (8.0 / 3 - 16.0 / 9), 1e-12);
  EXPECT_EQ(force_score(forces({})), 0.0);
}

TEST(ForceScore, IsLargerWherePixelsDisagree) {
  EXPECT_GT(force_score(forces({1, -1, 1, -1})), 2 * force_score(forces({1, 1, 1, 1})));
}

TEST(GrowthScore, TakesTheStatisticOfItsName) {
  const FragmentSums sums{10, 3, 7};
  EXPECT_EQ(growth_score(GrowthScore::gradient, 4, 2, sums), 0.5);
  EXPECT_EQ(growth_score(GrowthScore::gradient, 0, 2, sums), 2.0);
  EXPECT_EQ(growth_score(GrowthScore::force, 4, 2, sums), force_score(sums));
  EXPECT_EQ(growth_score(GrowthScore::error, 4, 2, sums), 3.0);
  EXPECT_EQ(growth_score(GrowthScore::edge, 4, 2, sums), 3.0);
  EXPECT_EQ(growth_score(GrowthScore::mask, 4, 2, sums), 7.0);
}

TEST(ChildOnAxis, LiesOnTheLongestAxis) {
  const SplitRules rules{SplitPlacement::axis, 1.35f, 0.55f, 0.893f};
  for (const float side : {1.0f, -1.0f}) {
    const ChildPlace child = child_on_axis(kLogScale, rules, side);
    EXPECT_EQ(child.offset, Vec3f(0, side * 1.35f, 0));
    EXPECT_EQ(child.scale, Vec3f(0.893f, 0.55f, 0.893f));
  }
}

TEST(ChildOnAxis, TakesTheFirstOfEqualAxes) {
  const SplitRules rules{SplitPlacement::axis, 1, 0.5f, 1};
  EXPECT_EQ(child_on_axis(Vec3f(2, 2, 2), rules, 1).offset, Vec3f(1, 0, 0));
  EXPECT_EQ(child_on_axis(Vec3f(1, 2, 2), rules, 1).offset, Vec3f(0, 1, 0));
  EXPECT_EQ(child_on_axis(Vec3f(1, 2, 3), rules, 1).offset, Vec3f(0, 0, 1));
}

// The variance of two equal halves at +-d is that of each half and d^2.
TEST(ChildOpacity, IsThatOfTheParentBitForBitByDefault) {
  for (const float stored : {-7.3f, 0.1f, 30.0f, std::nanf("")}) {
    const float child = child_logit_opacity(stored, {});
    EXPECT_TRUE(child == stored || (std::isnan(child) && std::isnan(stored)));
  }
}

TEST(ChildOpacity, IsAFactorOfTheParents) {
  SplitRules rules;
  rules.opacity_factor = 0.6f;
  EXPECT_NEAR(sigmoid(child_logit_opacity(logit(0.5f), rules)), 0.3f, 1e-6f);
}

TEST(ChildOpacity, StaysFiniteForOpaqueAndTransparentParents) {
  SplitRules rules;
  rules.opacity_factor = 0.5f;
  EXPECT_TRUE(std::isfinite(child_logit_opacity(100.0f, rules)));
  EXPECT_TRUE(std::isfinite(child_logit_opacity(-100.0f, rules)));
}

float lowered(float opacity, OpacityPolicy policy, float amount) {
  return sigmoid(lowered_logit_opacity(logit(opacity), {policy, amount}, logit(amount)));
}

TEST(LoweredOpacity, FollowsItsPolicy) {
  EXPECT_NEAR(lowered(0.5f, OpacityPolicy::none, 0.1f), 0.5f, 1e-6f);
  EXPECT_NEAR(lowered(0.5f, OpacityPolicy::reset, 0.1f), 0.1f, 1e-6f);
  EXPECT_NEAR(lowered(0.05f, OpacityPolicy::reset, 0.1f), 0.05f, 1e-6f);
  EXPECT_NEAR(lowered(0.5f, OpacityPolicy::halve, 0.1f), 0.25f, 1e-6f);
  EXPECT_NEAR(lowered(0.15f, OpacityPolicy::halve, 0.1f), 0.1f, 1e-6f);
}

TEST(GrowthTarget, RisesFromTheFirstCountToTheBudget) {
  for (const GrowthCurve curve : {GrowthCurve::linear, GrowthCurve::root, GrowthCurve::parabola}) {
    EXPECT_EQ(growth_target(curve, 0, 100, 1100), 100);
    EXPECT_EQ(growth_target(curve, 1, 100, 1100), 1100);
    std::int64_t before = 100;
    for (double u = 0; u <= 1; u += 0.05) {
      EXPECT_GE(growth_target(curve, u, 100, 1100), before);
      before = growth_target(curve, u, 100, 1100);
    }
  }
  EXPECT_EQ(growth_target(GrowthCurve::linear, 0.25, 100, 1100), 350);
  EXPECT_EQ(growth_target(GrowthCurve::root, 0.25, 100, 1100), 550);
  EXPECT_EQ(growth_target(GrowthCurve::parabola, 0.5, 100, 1100), 850);
  EXPECT_EQ(growth_target(GrowthCurve::none, 0.25, 100, 1100), 1100);
  EXPECT_EQ(growth_target(GrowthCurve::none, 0.25, 100, 0), 0);
}

// N_0 + (B - N_0) / s^(2 - u): s = 4 at the start, 2 halfway, 1 at the end.
TEST(GrowthTarget, OfARampFollowsTheSizeOfThePictures) {
  EXPECT_EQ(growth_target(GrowthCurve::ramp, 0, 100, 1700, 4), 100 + 1600 / 16);
  EXPECT_EQ(growth_target(GrowthCurve::ramp, 0.5, 100, 1700, 4),
            100 + std::llround(1600 / std::pow(2, 1.5)));
  EXPECT_EQ(growth_target(GrowthCurve::ramp, 1, 100, 1700, 4), 1700);
  EXPECT_EQ(growth_target(GrowthCurve::ramp, 0, 100, 1700, 1), 1700);
}

TEST(GrowthTarget, OfCurvesThatRiseNeedsABudget) {
  EXPECT_FALSE(needs_budget(GrowthCurve::none));
  EXPECT_TRUE(needs_budget(GrowthCurve::ramp));
}

TEST(AllowedGrowth, EndsAtTheTargetAndAtAShareOfWhatStays) {
  GrowthRules rules;
  rules.limits.max_gaussians = 130;
  EXPECT_EQ(allowed_growth(rules, 100), 30);
  EXPECT_EQ(allowed_growth(rules, 140), 0);
  rules.most_growth = 0.25f;  // exact
  EXPECT_EQ(allowed_growth(rules, 100), 25);
  rules.limits.max_gaussians = 0;
  EXPECT_EQ(allowed_growth(rules, 100), 25);
}

TEST(AscendingBits, AreOrderedAsTheFloatsWithNanFirst) {
  const float inf = std::numeric_limits<float>::infinity();
  const float ascending[] = {-inf, -3, -1e-30f, -0.0f, 0.0f, 1e-40f, 2, 2.0000002f, inf};
  std::uint32_t before = ascending_bits(std::nanf(""));
  for (const float value : ascending) {
    EXPECT_GT(ascending_bits(value), before) << value;
    before = ascending_bits(value);
  }
  EXPECT_EQ(ascending_bits(-std::nanf("")), 0u);
}

TEST(PruneKey, IsOfTheOpacityOrOfTheSumOfSquares) {
  const FragmentSums sums{1, 9, 4};
  EXPECT_EQ(prune_key(PruneOrder::opacity, -2.5f, sums), ascending_bits(-2.5f));
  EXPECT_EQ(prune_key(PruneOrder::sensitivity, -2.5f, sums), ascending_bits(4));
}

}  // namespace
}  // namespace gs
