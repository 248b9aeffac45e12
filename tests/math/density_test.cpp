// SPDX-License-Identifier: Apache-2.0
#include "gs_core/math/density/density.h"

#include "gs_core/math/random.h"
#include "gs_core/math/render/covariance.h"
#include "tests/support/test.h"

namespace gs {
namespace {

constexpr float kNoLimit = std::numeric_limits<float>::infinity();
const Quatf kUpright{1.0f, 0.0f, 0.0f, 0.0f};

AdaptiveRules rules(float prune_opacity, float prune_scale) {
  return {2e-4f, 0.01f, prune_opacity, prune_scale, 0};
}
float above(float x) { return std::nextafter(x, kNoLimit); }
float below(float x) { return std::nextafter(x, -kNoLimit); }

// (3 / 320, 4 / 240) in pixels^-1 is (3, 4) per half of a picture of 640 x 480.
TEST(ScreenGradientNorm, IsInUnitsOfHalfThePicture) {
  EXPECT_NEAR(screen_gradient_norm({3.0f / 320.0f, -4.0f / 240.0f}, 640, 480), 5.0f, 1e-6f);
}

TEST(WantsGrowth, ComparesTheMeanWithTheThreshold) {
  EXPECT_TRUE(wants_growth(4.0f, 1.0f, 0.25f));  // exactly at the threshold
  EXPECT_FALSE(wants_growth(4.0f, below(1.0f), 0.25f));
}

TEST(WantsGrowth, IsFalseForAGaussianThatWasNeverSeen) {
  EXPECT_FALSE(wants_growth(0.0f, 0.0f, 2e-4f));
}

TEST(IsSmall, ComparesTheLargestAxis) {
  const float limit = std::log(0.01f);
  EXPECT_TRUE(is_small({limit, -9.0f, -9.0f}, 0.01f));  // exactly at the limit: cloned
  EXPECT_FALSE(is_small({-9.0f, above(limit), -9.0f}, 0.01f));
  EXPECT_FALSE(is_small({-9.0f, -9.0f, above(limit)}, 0.01f));
}

TEST(IsSmall, IsFalseForEveryGaussianUnderALimitOfZero) {
  EXPECT_FALSE(is_small({-80.0f, -80.0f, -80.0f}, 0.0f));
}

// A quarter turn about z takes the Gaussian's x axis, two units long, to the world's y.
TEST(SplitMean, MovesAlongTheGaussiansOwnAxes) {
  const float h = std::sqrt(0.5f);
  const Vec3f mean = split_mean({1.0f, 1.0f, 1.0f}, {std::log(2.0f), 0.0f, 0.0f},
                                {h, 0.0f, 0.0f, h}, {1.5f, 0.0f, 0.0f});
  EXPECT_NEAR(mean.x, 1.0f, 1e-6f);
  EXPECT_NEAR(mean.y, 4.0f, 1e-6f);
  EXPECT_NEAR(mean.z, 1.0f, 1e-6f);
}

TEST(SplitMean, OfNormalDrawsHasTheCovarianceOfTheGaussian) {
  const Random random{1, RandomStream::test};
  const Vec3f log_scale{0.0f, -0.7f, 0.4f};
  const Quatf rotation{0.8f, 0.3f, -0.5f, 0.2f};
  constexpr int kDraws = 100'000;
  double xx = 0.0, xy = 0.0, yz = 0.0, zz = 0.0;
  for (int i = 0; i < kDraws; ++i) {
    const Vec4f n = random.normal4(std::uint64_t(i));
    const Vec3f p = split_mean({0.0f, 0.0f, 0.0f}, log_scale, rotation, {n.x, n.y, n.z});
    xx += double(p.x) * p.x / kDraws;
    xy += double(p.x) * p.y / kDraws;
    yz += double(p.y) * p.z / kDraws;
    zz += double(p.z) * p.z / kDraws;
  }
  const Sym3<float> sigma = covariance(rotation_matrix(rotation), variance(log_scale));
  // Entries are about 2, with a standard error of 2 sqrt(2 / 1e5) = 0.009.
  EXPECT_NEAR(xx, sigma.xx, 0.03);
  EXPECT_NEAR(xy, sigma.xy, 0.03);
  EXPECT_NEAR(yz, sigma.yz, 0.03);
  EXPECT_NEAR(zz, sigma.zz, 0.03);
}

TEST(SplitLogScale, DividesTheScaleByOnePointSix) {
  const Vec3f half = split_log_scale({0.0f, std::log(3.2f), -2.0f});
  EXPECT_NEAR(std::exp(half.x), 1.0f / 1.6f, 1e-6f);
  EXPECT_NEAR(std::exp(half.y), 2.0f, 1e-6f);
  EXPECT_NEAR(std::exp(half.z), std::exp(-2.0f) / 1.6f, 1e-6f);
}

TEST(IsPruned, BelowTheOpacityButNotAtIt) {
  EXPECT_FALSE(is_pruned(Vec3f(0.0f), {0.0f, 0.0f, 0.0f}, kUpright, 0.0f, rules(0.5f, kNoLimit)));
  EXPECT_TRUE(is_pruned(Vec3f(0.0f), {0.0f, 0.0f, 0.0f}, kUpright, -1e-6f, rules(0.5f, kNoLimit)));
}

TEST(IsPruned, AboveTheScaleButNotAtIt) {
  EXPECT_FALSE(is_pruned(Vec3f(0.0f), {0.0f, -1.0f, -1.0f}, kUpright, 3.0f, rules(0.1f, 1.0f)));
  EXPECT_TRUE(is_pruned(Vec3f(0.0f), {-1.0f, 1e-6f, -1.0f}, kUpright, 3.0f, rules(0.1f, 1.0f)));
}

TEST(IsPruned, AtNoScaleWhenTheLimitIsInfinite) {
  EXPECT_FALSE(
      is_pruned(Vec3f(0.0f), {50.0f, 50.0f, 50.0f}, kUpright, 3.0f, rules(0.1f, kNoLimit)));
}

TEST(IsPruned, WithoutARotation) {
  EXPECT_TRUE(is_pruned(Vec3f(0.0f), {0.0f, 0.0f, 0.0f}, {0.0f, 1e-5f, 0.0f, 0.0f}, 3.0f,
                        rules(0.1f, kNoLimit)));
}

TEST(IsPruned, WithAValueThatIsNotFinite) {
  const float nan = std::numeric_limits<float>::quiet_NaN();
  const AdaptiveRules all = rules(0.1f, kNoLimit);
  EXPECT_TRUE(is_pruned({0.0f, nan, 0.0f}, Vec3f(0.0f), kUpright, 3.0f, all));
  EXPECT_TRUE(is_pruned(Vec3f(0.0f), {0.0f, kNoLimit, 0.0f}, kUpright, 3.0f, all));
  EXPECT_TRUE(is_pruned(Vec3f(0.0f), Vec3f(0.0f), {nan, 0.0f, 0.0f, 0.0f}, 3.0f, all));
  EXPECT_TRUE(is_pruned(Vec3f(0.0f), Vec3f(0.0f), kUpright, nan, all));
}

}  // namespace
}  // namespace gs
