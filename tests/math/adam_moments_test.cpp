// SPDX-License-Identifier: Apache-2.0
// Adam's moments in 16 bits: what is exact, what is right on average, and how far rounding leads.
#include "gs_core/math/update/adam_moments.h"

#include "gs_core/math/update/adam.h"
#include "gs_core/math/update/moment_rounding.h"
#include "tests/support/scenes.h"

namespace gs {
namespace {

constexpr float kFloatMin = std::numeric_limits<float>::min();

std::uint32_t random_bits(Draws& draws) { return draws.below(0xffffffffu); }

struct Expected {
  static constexpr double kStepOfM = 0x1p-3, kStepOfV = 0x1p-2;
  static constexpr double kFinestStep = 0x1p-6;
  static constexpr float kLeastV = 1.25f * 0x1p-100f, kMostV = 1.75f * 0x1p27f;
  static constexpr int kRandomBitsOfM = 14, kRandomBitsOfV = 18;
  static constexpr double kErrorOfMean = 0x1p-18;  // of 2^-15 of a step
  static constexpr float kLargestQuotient = 15;
  static constexpr double kErrorOfStep = 0.19, kErrorOfWay = 0.3, kErrorOfV = 0.4;
};

TEST(HalfMoments, KeepsZeroWhateverTheRandomNumberIs) {
  for (const std::uint32_t random :
       {0u, 1u, 0x7fffu, 0x3ffffu, 0xffffu, 0xffff0000u, 0xffffffffu}) {
    EXPECT_EQ(HalfMoments::of(0, 0, random).bits, 0u);
    EXPECT_EQ(opened(HalfMoments::of(-0.0f, 0, random)).first, 0);
    EXPECT_EQ(opened(HalfMoments::of(0, 0.3f, random)).first, 0);
    EXPECT_EQ(opened(HalfMoments::of(0.3f, 0, random)).second, 0);
  }
}

TEST(HalfMoments, ComesBackFromItsNumbers) {
  for (std::uint32_t bits = 0; bits <= 0xffff; ++bits) {
    const HalfMoments code{std::uint16_t(bits)};
    if (opened(code).second == 0) continue;
    for (const std::uint32_t random : {0u, 0xffffffffu})
      ASSERT_EQ(HalfMoments::of(opened(code).first, opened(code).second, random).bits, code.bits);
  }
}

// The formula of adam_moments.h in double.
TEST(HalfMoments, HasTheNumbersOfItsFormula) {
  for (std::uint32_t c = 0; c < 512; ++c)
    for (std::uint32_t k = 0; k < 64; ++k) {
      const HalfMoments code{std::uint16_t(k << 9 | c)};
      const double v = c ? (1 + (c % 4) / 4.0) * std::pow(2, int(c / 4) - 100) : 0;
      const double n = k < 8 ? k : (8 + k % 8) * std::pow(2, int(k / 8) - 1);
      ASSERT_EQ(opened(code).second, v);
      ASSERT_EQ(opened(code).first, n * std::pow(2, int(c / 8) - 56));
      ASSERT_EQ(opened(HalfMoments{std::uint16_t(code.bits | 0x8000)}).first, -opened(code).first);
    }
}

// A step would be m / epsilon.
TEST(HalfMoments, HasNoFirstMomentWithoutASecondOne) {
  Draws draws(6);
  for (int i = 0; i < 100'000; ++i) {
    const float v = i % 2 ? draws.log_uniform(1e-44f, 1e-20f) : 0;
    const HalfMoments code = HalfMoments::of(draws.normal() * 1e-10f, v, random_bits(draws));
    EXPECT_EQ(opened(code).second > 0, v > 0);
    if (v == 0) {
      ASSERT_EQ(code.bits, 0);
    } else if (v < Expected::kLeastV) {
      ASSERT_EQ(opened(code).second, Expected::kLeastV);
    }
  }
}

TEST(HalfMoments, HasItsLargestNumbersForWhatIsLarger) {
  constexpr float kInfinity = std::numeric_limits<float>::infinity();
  for (const float large : {4e8f, 1e38f, kInfinity}) {
    const HalfMoments code = HalfMoments::of(-large, large, 0xffffffffu);
    EXPECT_EQ(opened(code).second, Expected::kMostV);
    EXPECT_EQ(opened(HalfMoments::of(-large, 1, 0)).first, -15);
  }
}

TEST(HalfMoments, IsWithinOneStepOfTheNumber) {
  Draws draws(1);
  for (int i = 0; i < 100'000; ++i) {
    const float v = draws.log_uniform(Expected::kLeastV, Expected::kMostV);
    const float m = draws.uniform(-7, 7) * std::sqrt(v) * (i % 2 ? 1 : draws.log_uniform(1e-6f, 1));
    const HalfMoments code = HalfMoments::of(m, v, random_bits(draws));
    const double step = std::max(Expected::kStepOfM * std::abs(m),
                                 Expected::kFinestStep * std::sqrt(double(opened(code).second)));
    ASSERT_LE(std::abs(double(opened(code).first) - m), step) << m << " of " << v;
    ASSERT_LT(std::abs(double(opened(code).second) / v - 1), Expected::kStepOfV) << v;
  }
}

// Over all values of the random bits that a number uses.
TEST(HalfMoments, IsTheNumberOnAverage) {
  constexpr std::uint32_t kWaysOfM = 1u << Expected::kRandomBitsOfM,
                          kWaysOfV = 1u << Expected::kRandomBitsOfV;
  Draws draws(2);
  for (int i = 0; i < 20; ++i) {
    const float v = draws.log_uniform(1e-24f, 1e6f);
    const float m = draws.normal() * std::sqrt(v);
    const float code_of_v = opened(HalfMoments::of(0, v, 0)).second;  // steps of m depend on it
    double sum_of_m = 0, sum_of_v = 0;
    for (std::uint32_t random = 0; random < kWaysOfM; ++random)
      sum_of_m +=
          opened(HalfMoments::of(m, code_of_v, random << (32 - Expected::kRandomBitsOfM))).first;
    for (std::uint32_t random = 0; random < kWaysOfV; ++random)
      sum_of_v += opened(HalfMoments::of(m, v, random)).second;
    const double size =
        std::max(double(std::abs(m)), Expected::kFinestStep / Expected::kStepOfM * std::sqrt(v));
    EXPECT_NEAR(sum_of_m / kWaysOfM / size, m / size, Expected::kErrorOfMean);
    EXPECT_NEAR(sum_of_v / kWaysOfV / v, 1, Expected::kErrorOfMean);
  }
}

// The mean and the standard deviation of v after some updates without gradients, as shares of what
// it is as a float.
std::pair<double, double> decayed(int rows, int steps) {
  const AdamStep step = adam_step(1, 0);
  std::vector<HalfMoments> codes(std::size_t(rows), HalfMoments::of(0, 1, 0));
  for (int t = 1; t <= steps; ++t) {
    const MomentRounding rounding{7, t};
    for (std::size_t i = 0; i < codes.size(); ++i) {
      float parameter = 0;
      adam_update(parameter, codes[i], 0, step, AdamRule(), rounding.of_row(i));
    }
  }
  double mean = 0, squares = 0;
  for (const HalfMoments code : codes) {
    const double ratio = opened(code).second / std::pow(kAdamBeta2, steps);
    mean += ratio / rows;
    squares += ratio * ratio / rows;
  }
  return {mean, std::sqrt(squares - mean * mean)};
}

// Rounded to nearest, v would not fall at all: a thousandth is less than half of its steps.
TEST(HalfMoments, LetsVDecayOverAThousandStepsAsAFloat) {
  const auto [mean, scatter] = decayed(4000, 1000);
  // One step of a fifth is taken with a probability of 1/200: a variance of 0.0002, and 0.2 after
  // 1,000. The mean of 4,000 has 0.7 %.
  EXPECT_NEAR(mean, 1, 0.03);
  EXPECT_LT(scatter, 0.55);
  EXPECT_GT(scatter, 0.3);
}

// For floats the bound is sqrt(((1 - b1)^2 / (1 - b2)) / (1 - b1^2 / b2)) = 7.27, and gradients
// that grow by b2 / b1 a step come to it. Codes have none above 15.
TEST(HalfMoments, KeepsTheQuotientThatMovesParametersBounded) {
  float largest = 0;
  Draws draws(4);
  const AdamStep step = adam_step(1'000'000, 1e-3f);
  for (int history = 0; history < 200; ++history) {
    const float growth = history % 2 ? 1.11f : draws.uniform(1.0f, 1.2f);
    float parameter = 0, gradient = 1e-12f;
    HalfMoments code{};
    for (int t = 1; t <= 300; ++t, gradient *= growth) {
      adam_update(parameter, code, gradient, step, AdamRule(), random_bits(draws));
      largest = std::max(largest, opened(code).first / std::sqrt(opened(code).second));
    }
  }
  EXPECT_LE(largest, Expected::kLargestQuotient);
  EXPECT_GT(largest, 7.2f);
}

// A parameter with noisy gradients, some of which are zero: with codes it goes where it goes with
// floats, but for a noise that is small beside its way.
TEST(HalfMoments, MovesParametersAsFloatsDo) {
  constexpr int kRows = 500, kSteps = 3000;
  Draws draws(5);
  double way = 0, difference = 0, error_of_v = 0, steps = 0, step_errors = 0, along = 0;
  for (std::size_t i = 0; i < kRows; ++i) {
    float p = 0, by_codes = 0;
    FloatMoments moments{};
    HalfMoments code{};
    const float size = draws.log_uniform(1e-9f, 1e-2f);
    for (int t = 1; t <= kSteps; ++t) {
      const float gradient = draws.chance(0.5f) ? 0 : size * draws.normal();
      const AdamStep step = adam_step(t, 1e-3f);
      const float before = p, before_by_codes = by_codes;
      adam_update(p, moments, gradient, step);
      adam_update(by_codes, code, gradient, step, AdamRule(), MomentRounding{3, t}.of_row(i));
      if (t <= kSteps / 2) continue;
      const double taken = double(p) - before, taken_by_codes = double(by_codes) - before_by_codes;
      steps += taken * taken;
      along += taken * taken_by_codes;
      step_errors += (taken_by_codes - taken) * (taken_by_codes - taken);
    }
    way += double(p) * p;
    difference += (double(by_codes) - p) * (double(by_codes) - p);
    error_of_v += std::pow(opened(code).second / moments.second - 1, 2) / kRows;
  }
  EXPECT_LT(std::sqrt(step_errors / steps), 1.1 * Expected::kErrorOfStep);
  EXPECT_GT(std::sqrt(step_errors / steps), 0.7 * Expected::kErrorOfStep);
  EXPECT_NEAR(along / steps, 1, Expected::kErrorOfV / 8);  // 1 / sqrt(v) is larger on average
  EXPECT_LT(std::sqrt(difference / way), Expected::kErrorOfWay);
  EXPECT_LT(std::sqrt(error_of_v), Expected::kErrorOfV);
}

TEST(MomentRounding, DependsOnSeedStepAndRow) {
  std::set<std::uint32_t> words;
  for (const std::uint64_t seed : {1u, 2u})
    for (const int t : {1, 2})
      for (const std::size_t row : {0, 1, 1 << 27}) {
        words.insert(MomentRounding{seed, t}.of_row(row));
        EXPECT_EQ(MomentRounding({seed, t}).of_row(row), MomentRounding({seed, t}).of_row(row));
      }
  EXPECT_EQ(words.size(), 12u);
}

TEST(RandomOffsets, AreDifferentButForTheTwoRotations) {
  Gaussians rows;
  rows.has_time = true;
  std::set<int> taken;
  int numbers = 0;
  for_each_array(
      [&](const char*, const auto& array, int offset) {
        for (int k = 0; k < int(sizeof(array[0]) / sizeof(float)); ++k, ++numbers)
          taken.insert(offset + k);
      },
      rows, kRandomOffsets);
  EXPECT_EQ(numbers, 65);
  EXPECT_EQ(int(taken.size()), numbers - 4);
  EXPECT_EQ(kRandomOffsets.right_rotation, kRandomOffsets.rotation);
}

}  // namespace
}  // namespace gs
