// SPDX-License-Identifier: Apache-2.0
#include "gs_core/math/photometric.h"

#include <gtest/gtest.h>

#include <cmath>

#include "gs_core/math/area_filter.h"
#include "tests/support/jet_oracle.h"

namespace gs {
namespace {

TEST(LensPlace, IsOneAtTheCornersAndZeroAtThePrincipalPoint) {
  const LensPlace place = lens_place(320, 240, 640, 480, 1);
  EXPECT_NEAR(place.rho(0, 0), 1, 1e-6);
  EXPECT_NEAR(place.rho(640, 480), 1, 1e-6);
  EXPECT_EQ(place.rho(320, 240), 0);
}

// A reduced photo leaves out columns that fill no whole block; what is left stays where it was.
TEST(LensPlace, OfAReducedPhotoIsThatOfThePhoto) {
  Camera camera;
  camera.width = 103;
  camera.height = 66;
  camera.cx = 50;
  camera.cy = 35;
  const Camera small = reduced(camera, 4);
  const LensPlace place = lens_place(camera.cx, camera.cy, 103, 66, 1),
                  of_small = lens_place(small.cx, small.cy, 103, 66, 4);
  for (const float x : {0.0f, 7.0f, 25.0f})
    EXPECT_NEAR(of_small.rho(x, 2.5f), place.rho(4 * x, 10), 1e-6) << x;
}

std::array<double, 3> coefficients(TestRandom& random) {
  return {random.uniform(-1, 1), random.uniform(-1, 1), random.uniform(-1, 1)};
}

TEST(LogVignetting, GradientMatchesJet) {
  const auto forward = [](const auto& x) {
    using T = std::decay_t<decltype(x[0])>;
    return std::array<T, 1>{log_vignetting(std::array<T, 3>{x[0], x[1], x[2]}, T(0.7))};
  };
  const auto vjp = [](const auto&, const std::array<double, 1>& G) {
    return log_vignetting_vjp(0.7, G[0]);
  };
  EXPECT_LT(worst_gradient_error(forward, vjp, coefficients), kJetTolerance);
}

// x, a, b1, b2, b3 at a random place: the whole way from a color to what the photo shows.
TEST(Gained, GradientMatchesJetThroughTheVignetting) {
  for (const double rho : {0.0, 0.3, 1.2}) {
    const auto forward = [rho](const auto& x) {
      using T = std::decay_t<decltype(x[0])>;
      const T B = log_vignetting(std::array<T, 3>{x[2], x[3], x[4]}, T(rho));
      return std::array<T, 1>{gained(x[0], x[1], B)};
    };
    const auto vjp = [rho](const std::array<double, 5>& x, const std::array<double, 1>& G) {
      const double B = log_vignetting(std::array<double, 3>{x[2], x[3], x[4]}, rho);
      const auto gradient = gained_vjp(gained(x[0], x[1], B), std::exp(x[1] - B), G[0]);
      return flatten(gradient.x, gradient.a, log_vignetting_vjp(rho, gradient.B));
    };
    const auto draw = [](TestRandom& random) {
      return flatten(random.uniform(-0.2, 1.5), random.uniform(-1, 1), coefficients(random));
    };
    EXPECT_LT(worst_gradient_error(forward, vjp, draw), kJetTolerance) << rho;
  }
}

TEST(GainPrior, GradientMatchesJet) {
  const auto forward = [](const auto& x) {
    using T = std::decay_t<decltype(x[0])>;
    const T off = (x[0] - T(0.3)) / T(0.5);
    return std::array<T, 1>{T(0.5) * T(0.01) * off * off};
  };
  const auto vjp = [](const std::array<double, 1>& x, const std::array<double, 1>& G) {
    return std::array<double, 1>{G[0] * gain_prior_vjp(x[0], 0.3, 0.01, 0.5)};
  };
  const auto draw = [](TestRandom& random) { return std::array<double, 1>{random.uniform(-1, 1)}; };
  EXPECT_LT(worst_gradient_error(forward, vjp, draw), kJetTolerance);
}

TEST(BrightRim, GradientMatchesJetOnBothSidesOfEveryThreshold) {
  int bright = 0, dark = 0;
  const auto forward = [](const auto& x) {
    using T = std::decay_t<decltype(x[0])>;
    return std::array<T, 1>{bright_rim(std::array<T, 3>{x[0], x[1], x[2]}, T(0.02))};
  };
  const auto vjp = [&](const std::array<double, 3>& b, const std::array<double, 1>& G) {
    for (const double rho : {0.25, 0.5, 1.0})
      ++(log_vignetting(b, rho) < log_vignetting(b, 0.0) ? bright : dark);
    std::array<double, 3> gradient = bright_rim_vjp(b, 0.02);
    for (double& g : gradient) g *= G[0];
    return gradient;
  };
  EXPECT_LT(worst_gradient_error(forward, vjp, coefficients), kJetTolerance);
  EXPECT_GT(bright, kEnoughCases);
  EXPECT_GT(dark, kEnoughCases);
}

// Sums over rho at the middles of 1,000 rings of the same area.
TEST(LensPolynomials, AreOrthogonalToEachOtherAndToAConstant) {
  double sums[3] = {}, products[3][3] = {};
  for (int i = 0; i < 1000; ++i) {
    const std::array<double, 3> P = lens_polynomials((i + 0.5) / 1000);
    for (std::size_t r = 0; r < 3; ++r) {
      sums[r] += P[r] / 1000;
      for (std::size_t c = 0; c < 3; ++c) products[r][c] += P[r] * P[c] / 1000;
    }
  }
  for (std::size_t r = 0; r < 3; ++r) {
    EXPECT_NEAR(sums[r], 0, 1e-5);
    for (std::size_t c = 0; c < 3; ++c)
      EXPECT_NEAR(products[r][c], r == c ? 1.0 / (2 * double(r) + 3) : 0.0, 1e-5);
  }
}

// The light that reaches a picture falls with cos^4 of the angle. Projections on the polynomials.
TEST(LogVignetting, FitsTheFalloffOfALensOutTo40Degrees) {
  const double k =
      std::pow(std::tan(40 * std::acos(-1.0) / 180), 2);  // tan^2 of the angle at rho = 1
  const auto truth = [k](double rho) { return 2 * std::log1p(k * rho); };
  std::array<double, 3> b{};
  double mean = 0;
  for (int i = 0; i < 1000; ++i) {
    const double rho = (i + 0.5) / 1000;
    const std::array<double, 3> P = lens_polynomials(rho);
    mean += truth(rho) / 1000;
    for (std::size_t r = 0; r < 3; ++r) b[r] += truth(rho) * P[r] * (2 * double(r) + 3) / 1000;
  }
  EXPECT_EQ(bright_rim(b, 1.0), 0);
  for (int i = 0; i <= 20; ++i) {
    const double rho = i / 20.0;
    EXPECT_NEAR(mean + log_vignetting(b, rho), truth(rho), 0.004) << rho;
  }
}

}  // namespace
}  // namespace gs
