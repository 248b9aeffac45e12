// SPDX-License-Identifier: Apache-2.0
#include "gs_core/math/render/filter_3d.h"

#include "gs_core/math/render/activations.h"
#include "tests/support/jet_oracle.h"

namespace gs {
namespace {

// 100 x 60 pixels, at the origin, looking along z.
const PinholeCamera<double> kCamera{100, 60, 50.0, 80.0, 50.0, 30.0};

TEST(SamplingRate, IsTheFinerFocalLengthOverTheDepth) {
  EXPECT_DOUBLE_EQ(sampling_rate(kCamera, Vec3d(0.0, 0.0, 4.0), 0.2), 20.0);
  EXPECT_DOUBLE_EQ(filter_scale_of(20.0), std::sqrt(double(kFilter3dVariance)) / 20.0);
}

// At depth 2 the picture is 4 units wide and 1.5 high. The margin is 0.15 of that on each side.
TEST(SamplingRate, IsZeroBeyondThePictureAndItsMargin) {
  const auto is_seen = [](double x, double y) {
    return sampling_rate(kCamera, Vec3d(x, y, 2.0), 0.2) > 0;
  };
  EXPECT_TRUE(is_seen(2.59, 0.0));
  EXPECT_FALSE(is_seen(2.61, 0.0));
  EXPECT_TRUE(is_seen(-2.59, 0.0));
  EXPECT_FALSE(is_seen(-2.61, 0.0));
  EXPECT_TRUE(is_seen(0.0, 0.974));
  EXPECT_FALSE(is_seen(0.0, 0.976));
  EXPECT_TRUE(is_seen(0.0, -0.974));
  EXPECT_FALSE(is_seen(0.0, -0.976));
}

TEST(SamplingRate, IsZeroBeforeTheNearPlaneAndWithoutNumbers) {
  EXPECT_GT(sampling_rate(kCamera, Vec3d(0.0, 0.0, 0.2), 0.2), 0);
  EXPECT_EQ(sampling_rate(kCamera, Vec3d(0.0, 0.0, 0.19), 0.2), 0);
  EXPECT_EQ(sampling_rate(kCamera, Vec3d(0.0, 0.0, -3.0), 0.2), 0);
  const double nan = std::numeric_limits<double>::quiet_NaN();
  EXPECT_EQ(sampling_rate(kCamera, Vec3d(nan, 0.0, 3.0), 0.2), 0);
  EXPECT_EQ(sampling_rate(kCamera, Vec3d(0.0, 0.0, nan), 0.2), 0);
}

// |diag(1, 4, 9)| / |diag(2, 5, 10)| = 36 / 100.
TEST(FilterFactor, IsTheHandValue) {
  EXPECT_DOUBLE_EQ(filter_factor(Vec3d(1.0, 4.0, 9.0), 1.0), 0.6);
  EXPECT_EQ(filter_factor(Vec3d(1.0, 4.0, 9.0), 0.0), 1.0);
  // GPU kernels take 0 for "no filter", also where a variance is too small for a number.
  EXPECT_EQ(filter_factor(Vec3f(0.0f, 4.0f, 9.0f), 0.0f), 1.0f);
  EXPECT_EQ(filter_factor_vjp(Vec3f(0.0f, 4.0f, 9.0f), 0.0f, 1.0f, 1.0f), Vec3f(0.0f));
}

TEST(FilterFactor, OfTheThinnestGaussianIsZeroAndSoIsItsGradient) {
  const Vec3<float> thin = variance(Vec3<float>(-200.0f));
  const float factor = filter_factor(thin, 0.1f);
  EXPECT_EQ(factor, 0);
  EXPECT_EQ(filter_factor_vjp(thin, 0.1f, factor, 1.0f), Vec3<float>(0.0f));
}

}  // namespace
}  // namespace gs
