// SPDX-License-Identifier: Apache-2.0
#include "gs_core/math/update/adam.h"

#include "tests/support/test.h"

namespace gs {
namespace {

struct Parameter {
  float value = 0.0f;
  FloatMoments moments{};
  void update(float gradient, int t, float learning_rate) {
    adam_update(value, moments, gradient, adam_step(t, learning_rate));
  }
};

// m = 0.1 g, v = 0.001 g^2, both corrections undo these factors: g / |g|.
TEST(Adam, FirstStepIsTheLearningRateAgainstTheSignOfTheGradient) {
  for (const float gradient : {1e-6f, -1e-3f, 0.5f, -1e4f}) {
    Parameter parameter;
    parameter.update(gradient, 1, 0.01f);
    // 1e-6 relative
    EXPECT_NEAR(parameter.value, gradient > 0.0f ? -0.01f : 0.01f, 1e-8f) << gradient;
  }
}

// Zero moments at a large t: 0.1 g / sqrt(0.001 g^2) = sqrt(10), the corrections being 1.
TEST(Adam, NewRowAtALateStepFirstMovesByRootTenLearningRates) {
  Parameter parameter;
  parameter.update(0.3f, 30'000, 1e-3f);
  EXPECT_NEAR(parameter.value, -std::sqrt(10.0) * 1e-3, 1e-8);
}

TEST(Adam, RowWithoutAnyGradientStaysWhereItIs) {
  Parameter parameter{1.5f};
  for (int t = 1; t <= 10; ++t) parameter.update(0.0f, t, 0.1f);
  EXPECT_EQ(parameter.value, 1.5f);
}

// The square of 1e-25 is 0 in float; epsilon alone stands below the fraction then.
TEST(Adam, VanishingGradientGivesAFiniteStep) {
  Parameter parameter;
  parameter.update(1e-25f, 1, 0.1f);
  EXPECT_TRUE(std::isfinite(parameter.value));
  EXPECT_NEAR(parameter.value, 0.0f, 0.1f);
}

TEST(Adam, AThousandStepsAgreeWithThePaperInDouble) {
  std::mt19937 random(7);
  Parameter parameter;
  double value = 0.0, m = 0.0, v = 0.0;
  for (int t = 1; t <= 1000; ++t) {
    const float gradient = float(std::uniform_int_distribution<int>(-500, 1000)(random)) * 1e-5f;
    parameter.update(gradient, t, 0.01f);
    m = 0.9 * m + 0.1 * gradient;
    v = 0.999 * v + 0.001 * gradient * gradient;
    const double m_hat = m / (1.0 - std::pow(0.9, t)), v_hat = v / (1.0 - std::pow(0.999, t));
    value -= 0.01 * m_hat / (std::sqrt(v_hat) + 1e-15);
  }
  // Floats round each of the 1000 steps at 6e-8 of the value.
  EXPECT_NEAR(parameter.value / value, 1.0, 1e-5);
}

// |m| / sqrt(v) <= (1 - b1) / sqrt((1 - b2)(1 - b1^2 / b2)) = 7.27 for every history (Cauchy-Schwarz).
TEST(Adam, NoHistoryMovesByMoreThanSevenLearningRates) {
  std::mt19937 random(11);
  for (int history = 0; history < 200; ++history) {
    Parameter parameter;
    float growth = std::uniform_real_distribution<float>(0.5f, 2.0f)(random), gradient = 1e-6f;
    for (int t = 20'000; t < 20'050; ++t) {
      const float before = parameter.value;
      parameter.update(gradient, t, 1.0f);
      EXPECT_LE(std::abs(parameter.value - before), 7.28f);
      gradient *= growth;
    }
  }
}

}  // namespace
}  // namespace gs
