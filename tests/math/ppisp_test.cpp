// SPDX-License-Identifier: Apache-2.0
#include "gs_core/math/ppisp.h"

#include <gtest/gtest.h>

#include <cmath>

#include "tests/support/jet_oracle.h"

namespace gs {
namespace {

constexpr std::size_t kNumbers = 11;  // eight latents and a color

template <class T>
ColorLatents<T> latents_in(const std::array<T, kNumbers>& x) {
  ColorLatents<T> latents;
  for (std::size_t i = 0; i < 8; ++i) latents[i] = x[i];
  return latents;
}
template <class T>
Vec3<T> color_in(const std::array<T, kNumbers>& x) {
  return {x[8], x[9], x[10]};
}

/// Latents within three of their spreads, as the photos of one camera have, and a color.
std::array<double, kNumbers> draw(TestRandom& random) {
  std::array<double, kNumbers> x;
  for (std::size_t i = 0; i < 8; ++i) x[i] = random.uniform(-3, 3);
  for (std::size_t i = 8; i < kNumbers; ++i) x[i] = random.uniform(0.01, 1.2);
  return x;
}

TEST(Recolored, IsTheColorItselfWithoutLatents) {
  const Vec3d x{0.2, 0.7, 0.4}, y = recolored(color_matrix(ColorLatents<double>{}), x);
  for (int c = 0; c < 3; ++c) EXPECT_NEAR(y[c], x[c], 1e-12);
}

TEST(Recolored, KeepsTheSumOfAColorAndLeavesBlackBlack) {
  TestRandom random;
  for (int i = 0; i < 100; ++i) {
    const std::array<double, kNumbers> x = draw(random);
    const ColorMatrix<double> matrix = color_matrix(latents_in(x));
    const Vec3d color = color_in(x), y = recolored(matrix, color);
    EXPECT_NEAR(y.x + y.y + y.z, color.x + color.y + color.z, 1e-4);
    EXPECT_EQ(recolored(matrix, Vec3d(0.0)), Vec3d(0.0));
  }
}

// PPISP (2026): the homography takes each primary to its target.
TEST(Recolored, TakesPrimariesAndWhiteToTheirTargets) {
  TestRandom random;
  const std::array<double, kNumbers> x = draw(random);
  const ColorLatents<double> latents = latents_in(x);
  const ColorMatrix<double> matrix = color_matrix(latents);
  const Vec3d from[4] = {{0, 0, 1}, {1, 0, 0}, {0, 1, 0}, {1.0 / 3, 1.0 / 3, 1.0 / 3}};
  for (int j = 0; j < 4; ++j) {
    const LatentScale scale = latent_scale(j);
    const double a = latents[std::size_t(2 * j)], b = latents[std::size_t(2 * j + 1)];
    const Vec3d y = recolored(matrix, from[j]);
    const double sum = y.x + y.y + y.z;
    EXPECT_NEAR(y.x / sum, from[j].x + double(scale.m00) * a + double(scale.m01) * b, 1e-9) << j;
    EXPECT_NEAR(y.y / sum, from[j].y + double(scale.m10) * a + double(scale.m11) * b, 1e-9) << j;
  }
}

/// The whole way from latents and a color to what the photo shows, and its gradient.
constexpr auto kForward = [](const auto& x) {
  return flatten(recolored(color_matrix(latents_in(x)), color_in(x)));
};
constexpr auto kVjp = [](const std::array<double, kNumbers>& x, const std::array<double, 3>& G) {
  const ColorMatrix<double> matrix = color_matrix(latents_in(x));
  RecoloredSums<double> sums;
  const Vec3d dL_dx = recolored_vjp(matrix, color_in(x), {G[0], G[1], G[2]}, 1.0, sums);
  return flatten(color_matrix_vjp(matrix, sums), dL_dx);
};

TEST(Recolored, GradientMatchesJetByLatentsAndColor) {
  EXPECT_LT(worst_gradient_error(kForward, kVjp, draw), 100 * kJetTolerance);
}

// Far from neutral a factor reaches its limit, and what holds it there has no gradient.
TEST(Recolored, GradientMatchesJetWhereAFactorIsAtItsLimit) {
  int limited = 0;
  const auto far = [&](TestRandom& random) {
    std::array<double, kNumbers> x = draw(random);
    x[6] = random.uniform(-30, -20);  // a white without red
    x[7] = random.uniform(-1, 1);
    limited += color_matrix(latents_in(x)).k.x <= double(kLeastColorGain);
    return x;
  };
  EXPECT_LT(worst_gradient_error(kForward, kVjp, far), 1000 * kJetTolerance);
  EXPECT_GT(limited, kEnoughCases);
}

TEST(LatentsOfGains, MultiplyGrayByTheGains) {
  const Vec3d gains{1.1, 0.95, 1.3};
  const Vec3d y = recolored(color_matrix(latents_of_gains(gains)), Vec3d(0.5));
  const double exposure = (gains.x + gains.y + gains.z) / 3;
  for (int c = 0; c < 3; ++c) EXPECT_NEAR(exposure * y[c], 0.5 * gains[c], 1e-9);
}

}  // namespace
}  // namespace gs
