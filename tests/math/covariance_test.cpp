// SPDX-License-Identifier: Apache-2.0
#include "gs_core/math/render/covariance.h"

#include "tests/support/jet_oracle.h"

namespace gs {
namespace {

const Mat3<double> kIdentity{{1.0, 0.0, 0.0}, {0.0, 1.0, 0.0}, {0.0, 0.0, 1.0}};

TEST(Covariance, OfAnUnrotatedGaussianIsTheDiagonalOfItsVariances) {
  EXPECT_EQ(flatten(covariance(kIdentity, Vec3d{1.0, 4.0, 9.0})),
            (std::array{1.0, 0.0, 0.0, 4.0, 0.0, 9.0}));
}

// R = [3 -4 0; 4 3 0; 0 0 5] / 5 turns about z, variances (25, 100, 4). By hand:
// xx = (9*25 + 16*100)/25 = 73, xy = 12*(25 - 100)/25 = -36, yy = (16*25 + 9*100)/25 = 52, zz = 4.
TEST(Covariance, OfAThreeFourFiveRotationIsTheHandValue) {
  const Mat3<double> R{{0.6, -0.8, 0.0}, {0.8, 0.6, 0.0}, {0.0, 0.0, 1.0}};
  const auto sigma = flatten(covariance(R, Vec3d{25.0, 100.0, 4.0}));
  const std::array expected{73.0, -36.0, 0.0, 52.0, 0.0, 4.0};
  for (std::size_t i = 0; i < 6; ++i) EXPECT_NEAR(sigma[i], expected[i], 1e-13) << "entry " << i;
}

TEST(Covariance, GradientMatchesJet) {
  const double worst = worst_gradient_error(
      [](const auto& x) {
        Unflatten in(x);
        const auto R = in.mat3();
        return flatten(covariance(R, in.vec3()));
      },
      [](const auto& x, const auto& g) {
        Unflatten in(x);
        const auto R = in.mat3();
        const auto dL = covariance_vjp(R, in.vec3(), gradient_matrix(Unflatten(g).sym3()));
        return flatten(dL.R, dL.variance);
      },
      [](TestRandom& random) {  // any matrix works; the formula needs no rotation
        return flatten(random.uniform3(-1.0, 1.0), random.uniform3(-1.0, 1.0),
                       random.uniform3(-1.0, 1.0), random.uniform3(0.001, 2.0));
      });
  EXPECT_LT(worst, kJetTolerance);
}

}  // namespace
}  // namespace gs
