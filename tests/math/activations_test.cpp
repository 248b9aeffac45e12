// SPDX-License-Identifier: Apache-2.0
#include "gs_core/math/render/activations.h"

#include "tests/support/jet_oracle.h"

namespace gs {
namespace {

TEST(Sigmoid, HasTheValuesOfItsClosedForm) {
  EXPECT_EQ(sigmoid(0.0), 0.5);
  EXPECT_NEAR(sigmoid(std::log(3.0)), 0.75, 1e-16);
  EXPECT_NEAR(sigmoid(-std::log(4.0)), 0.2, 1e-16);
}

TEST(Sigmoid, StaysFiniteForHugeLogits) {
  EXPECT_EQ(sigmoid(1e30f), 1.0f);
  EXPECT_EQ(sigmoid(-1e30f), 0.0f);  // exp(-x) overflows to infinity, and 1 / infinity is 0
}

TEST(Logit, InvertsSigmoid) {
  for (double x = -12.0; x <= 12.0; x += 0.01) {
    EXPECT_NEAR(logit(sigmoid(x)), x, 1e-10) << x;  // 1 - o has ten digits at x = 12
  }
}

TEST(Variance, IsTheSquareOfTheExponential) {
  const Vec3d v = variance(Vec3d{0.0, std::log(2.0), std::log(0.1)});
  EXPECT_EQ(v.x, 1.0);
  EXPECT_NEAR(v.y, 4.0, 1e-15);
  EXPECT_NEAR(v.z, 0.01, 1e-17);
}

}  // namespace
}  // namespace gs
