// SPDX-License-Identifier: Apache-2.0
#include "gs_core/math/loss/ssim.h"

#include "tests/support/jet_oracle.h"

namespace gs {
namespace {

/// Moments of two constant pictures.
WindowMeans<double> constant_pictures(double x, double y) { return {x, y, x * x, y * y, x * y}; }

/// Moments that two pictures in [0, 1] may have: variances >= 0, correlation in [-1, 1].
WindowMeans<double> draw_moments(TestRandom& random) {
  const double x = random.uniform(0.0, 1.0), y = random.uniform(0.0, 1.0);
  const double sx = std::pow(10.0, random.uniform(-4.0, -0.3)),
               sy = std::pow(10.0, random.uniform(-4.0, -0.3));
  return {x, y, x * x + sx * sx, y * y + sy * sy, x * y + random.uniform(-1.0, 1.0) * sx * sy};
}

TEST(SsimWindow, IsTheNormalizedGaussianOfSigmaOneAndAHalf) {
  double sum = 0.0;
  for (int d = -kSsimRadius; d <= kSsimRadius; ++d) sum += std::exp(-d * d / 4.5);
  for (int d = 0; d <= kSsimRadius; ++d) {
    EXPECT_NEAR(kSsimWindow[d], std::exp(-d * d / 4.5) / sum, 2e-8) << d;  // rounding to float
  }
}

// Without variance the second factor is C2 / C2: (2 * 0.5 * 0.25 + 1e-4) / (0.25 + 0.0625 + 1e-4).
TEST(SsimIndex, OfConstantPicturesComparesTheirMeans) {
  EXPECT_NEAR(ssim_index(constant_pictures(0.5, 0.25)), 0.2501 / 0.3126, 1e-9);  // C1 is a float
}

// Means 0.5, variances 0.04 and 0.01, covariance -0.02: (1) * (-0.04 + 9e-4) / (0.05 + 9e-4).
TEST(SsimIndex, OfOppositePicturesIsNegative) {
  EXPECT_NEAR(ssim_index(WindowMeans<double>{0.5, 0.5, 0.29, 0.26, 0.23}), -0.0391 / 0.0509,
              1e-9);  // C2 is a float
}

TEST(SsimIndex, GradientByTheMomentsOfTheRenderedPictureMatchesJet) {
  double y = 0.0, yy = 0.0;
  const double worst = worst_gradient_error(
      [&](const auto& x) {
        using T = std::decay_t<decltype(x[0])>;
        return flatten(ssim_index(WindowMeans<T>{x[0], T(y), x[1], T(yy), x[2]}));
      },
      [&](const auto& x, const auto& g) {
        const auto dL = ssim_index_vjp(WindowMeans<double>{x[0], y, x[1], yy, x[2]}, g[0]);
        return flatten(dL.x, dL.xx, dL.xy);
      },
      [&](TestRandom& random) {
        const WindowMeans<double> m = draw_moments(random);
        y = m.y;
        yy = m.yy;
        return flatten(m.x, m.xx, m.xy);
      });
  EXPECT_LT(worst, kJetTolerance);
}

}  // namespace
}  // namespace gs
