// SPDX-License-Identifier: Apache-2.0
#include "gs_core/math/density/mcmc.h"

#include "gs_core/math/random.h"
#include "tests/support/jet_oracle.h"

namespace gs {
namespace {

// log scales and logit
std::array<double, 4> draw_covariance_entries(TestRandom& random) {
  return flatten(random.uniform3(-6.0, 1.0), random.uniform(-9.0, 9.0));
}

TEST(Regularizer, GradientMatchesJet) {
  const Regularizers of_each{0.3f, 0.07f};
  const auto forward = [&]<class T>(const std::array<T, 4>& x) {
    Unflatten in(x);
    const Vec3<T> log_scale = in.vec3();
    return std::array<T, 1>{regularizer(log_scale, in.scalar(), of_each)};
  };
  const auto vjp = [&](const std::array<double, 4>& x, const std::array<double, 1>& dL) {
    Unflatten in(x);
    const Vec3d log_scale = in.vec3();
    const RegularizerGradient<double> g = regularizer_vjp(log_scale, in.scalar(), of_each);
    return flatten(dL[0] * g.log_scale, dL[0] * g.logit_opacity);
  };
  EXPECT_LT(worst_gradient_error(forward, vjp, draw_covariance_entries), kJetTolerance);
}

TEST(Regularizer, OverAllGaussiansIsTheMeanOpacityAndTheMeanScale) {
  const Regularizers of_each = Regularizers{0.5f, 2.0f}.of_each(4);
  double sum = 0.0;
  for (int i = 0; i < 4; ++i)
    sum += regularizer(Vec3d(0.0, std::log(2.0), std::log(3.0)), 0.0, of_each);
  EXPECT_NEAR(sum, 0.5 * 0.5 + 2.0 * 2.0, 1e-6);  // the weights are floats
}

TEST(PositionNoise, IsTheCovarianceTimesTheDrawForAFaintGaussian) {
  const Vec3d log_scale{0.1, -0.5, 0.4}, normal{0.3, -1.2, 0.8};
  const Quat<double> rotation{0.8, 0.3, -0.5, 0.2};
  const Vec3d noise = position_noise(log_scale, rotation, -30.0, normal, 2.0);
  const double gate = 1.0 / (1.0 + std::exp(-0.5));  // o = 0: sigmoid(100 * 0.005)
  const Vec3d expected =
      2.0 * gate * multiply(covariance(rotation_matrix(rotation), variance(log_scale)), normal);
  // 0.005 is a float
  for (int axis = 0; axis < 3; ++axis) EXPECT_NEAR(noise[axis], expected[axis], 1e-7);
}

TEST(PositionNoise, IsHalvedAtItsOpacityAndGoneForAnOpaqueGaussian) {
  const Quat<double> upright{1.0, 0.0, 0.0, 0.0};
  const Vec3d zero(0.0), normal(1.0);
  EXPECT_NEAR(position_noise(zero, upright, logit(0.005), normal, 1.0).x, 0.5, 1e-7);
  EXPECT_LT(position_noise(zero, upright, logit(0.5), normal, 1.0).x, 1e-20);
  EXPECT_EQ(position_noise(Vec3f(0.0f), {1.0f, 0.0f, 0.0f, 0.0f}, 20.0f, Vec3f(1.0f), 1.0f).x, 0);
}

TEST(PositionNoise, OfAGaussianWithoutARotationIsZero) {
  const Vec3f noise =
      position_noise(Vec3f(0.0f), {0.0f, 0.0f, 0.0f, 0.0f}, -9.0f, Vec3f(1.0f), 1.0f);
  EXPECT_EQ(noise, Vec3f(0.0f));
}

TEST(DrawWeight, IsTheOpacityAndZeroForTheDead) {
  EXPECT_EQ(draw_weight(0.0f, 0.005f), 1u << 23);
  EXPECT_EQ(draw_weight(100.0f, 0.005f), 1u << 24);
  EXPECT_EQ(draw_weight(float(logit(0.00499)), 0.005f), 0u);
  EXPECT_NEAR(double(draw_weight(float(logit(0.00501)), 0.005f)), 0.00501 * 0x1p24, 2.0);
  EXPECT_EQ(draw_weight(std::numeric_limits<float>::quiet_NaN(), 0.005f), 0u);
}

TEST(DrawWeight, OfTheLeastOpacityOfACopyIsThatOfADeadOne) {
  EXPECT_EQ(draw_weight(0.0f, 0.5f), 0u);  // exactly at the threshold
}

TEST(SharedOpacity, KeepsWhatTheCopiesCoverTogether) {
  for (const double opacity : {0.006, 0.1, 0.5, 0.9, 0.999})
    for (const int copies : {1, 2, 3, 10, 51})
      EXPECT_NEAR(1.0 - std::pow(1.0 - shared_opacity(opacity, copies), copies), opacity, 1e-12)
          << opacity << " " << copies;
}

// The double sum of the paper, with binomial coefficients computed here.
double double_sum(double new_opacity, int copies) {
  double sum = 0.0;
  for (int i = 1; i <= copies; ++i) {
    double binomial = 1.0;
    for (int k = 0; k <= i - 1; ++k) {
      sum += binomial * (k % 2 ? -1.0 : 1.0) * std::pow(new_opacity, k + 1) / std::sqrt(k + 1.0);
      binomial *= double(i - 1 - k) / (k + 1);
    }
  }
  return sum;
}

TEST(SharedScale, IsThePapersDoubleSum) {
  for (const double opacity : {0.006, 0.1, 0.5, 0.9, 0.999})
    for (const int copies : {1, 2, 3, 7, 20, 51}) {
      const double share = shared_opacity(opacity, copies);
      const double expected = opacity / double_sum(share, copies);
      EXPECT_NEAR(shared_scale(opacity, share, copies) / expected, 1.0, 1e-9)
          << opacity << " " << copies;
    }
}

TEST(SharedGaussian, IsFiniteForEveryOpacityAndAnyNumberOfCopies) {
  for (const float logit_opacity : {-5.0f, 0.0f, 5.0f, 15.0f, 40.0f, 1e30f})
    for (const int copies : {1, 2, 51, 52, 100000}) {
      const SharedGaussian shared =
          shared_gaussian(logit_opacity, {0.0f, -1.0f, 2.0f}, copies, 0.005f);
      EXPECT_TRUE(std::isfinite(shared.logit_opacity)) << logit_opacity << " " << copies;
      EXPECT_TRUE(is_finite(shared.log_scale)) << logit_opacity << " " << copies;
      EXPECT_GE(sigmoid(double(shared.logit_opacity)), 0.005 - 1e-8);
      EXPECT_LE(shared.log_scale.x, 1e-6f);
      EXPECT_FLOAT_EQ(shared.log_scale.z - shared.log_scale.y, 3.0f);
    }
}

TEST(SharedGaussian, CountsNoMoreThan51Copies) {
  const SharedGaussian most = shared_gaussian(2.0f, Vec3f(0.0f), kMostCopies, 0.005f);
  const SharedGaussian more = shared_gaussian(2.0f, Vec3f(0.0f), 1000, 0.005f);
  EXPECT_EQ(most.logit_opacity, more.logit_opacity);
  EXPECT_EQ(most.log_scale, more.log_scale);
}

}  // namespace
}  // namespace gs
