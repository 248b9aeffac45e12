// SPDX-License-Identifier: Apache-2.0
// Adam's moments as codes of 16 bits: what is exact, what is right on average, and how far rounding
// leads.
#include "gs_core/math/moment_code.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <limits>
#include <set>
#include <vector>

#include "tests/support/scenes.h"

namespace gs {
namespace {

constexpr double kStepOfM = 0x1p-7, kStepOfV = 0x1p-8;  // largest relative distance of two codes
constexpr float kFloatMin = std::numeric_limits<float>::min();

std::uint32_t random_bits(Draws& draws) { return draws.below(0xffffffffu); }

TEST(MomentCode, KeepsZeroWhateverTheRandomNumberIs) {
  for (const std::uint32_t random : {0u, 1u, 0x7fffu, 0xffffu, 0xffff0000u, 0xffffffffu}) {
    EXPECT_EQ(moment_code(0, 0, random).bits, 0u);
    EXPECT_EQ(first_moment(moment_code(-0.0f, 0, random)), 0);
    EXPECT_EQ(first_moment(moment_code(0, 0.3f, random)), 0);
    EXPECT_EQ(second_moment(moment_code(0.3f, 0, random)), 0);
  }
}

// Also denormal numbers: they are not flushed.
TEST(MomentCode, ComesBackFromItsNumbers) {
  constexpr std::uint32_t kFinite = 0xff00;  // exponents below that of infinity
  for (std::uint32_t v = 0; v < kFinite; ++v) {
    const std::uint32_t m = v % 0x7f80;
    for (const std::uint32_t sign : {0u, 0x80000000u}) {
      const MomentCode code{sign | m << 16 | v};
      for (const std::uint32_t random : {0u, 0xffffffffu})
        ASSERT_EQ(moment_code(first_moment(code), second_moment(code), random).bits, code.bits);
    }
  }
}

TEST(MomentCode, IsWithinOneStepOfTheNumber) {
  Draws draws(1);
  for (int i = 0; i < 100'000; ++i) {
    const float m = draws.normal() * draws.log_uniform(1e-30f, 1e30f);
    const float v = draws.log_uniform(kFloatMin, 1e37f);
    const MomentCode code = moment_code(m, v, random_bits(draws));
    ASSERT_LT(std::abs(double(first_moment(code)) / m - 1), kStepOfM) << m;
    ASSERT_LT(std::abs(double(second_moment(code)) / v - 1), kStepOfV) << v;
  }
}

// Over all values of the random bits that a number uses.
TEST(MomentCode, IsTheNumberOnAverage) {
  Draws draws(2);
  for (int i = 0; i < 20; ++i) {
    const float m = draws.normal() * draws.log_uniform(1e-12f, 1e3f);
    const float v = draws.log_uniform(1e-24f, 1e6f);
    double sum_of_m = 0, sum_of_v = 0;
    for (std::uint32_t random = 0; random < 1u << kDroppedBitsOfM; ++random)
      sum_of_m += first_moment(moment_code(m, v, random << 16));
    for (std::uint32_t random = 0; random < 1u << kDroppedBitsOfV; ++random)
      sum_of_v += second_moment(moment_code(m, v, random));
    EXPECT_NEAR(sum_of_m / (1 << kDroppedBitsOfM) / m, 1, 1e-9);
    EXPECT_NEAR(sum_of_v / (1 << kDroppedBitsOfV) / v, 1, 1e-9);
  }
}

// The right rotation of a static Gaussian stays the mirror of the left one.
TEST(MomentCode, RoundsNumbersOfOppositeSignAlike) {
  Draws draws(3);
  for (int i = 0; i < 1000; ++i) {
    const float m = draws.normal();
    const std::uint32_t random = random_bits(draws);
    EXPECT_EQ(first_moment(moment_code(-m, 1, random)), -first_moment(moment_code(m, 1, random)));
  }
}

// Rounded to nearest, v would not fall at all: a thousandth is less than half of its steps.
TEST(MomentCode, LetsVDecayOverTenThousandStepsAsAFloat) {
  constexpr int kRows = 2000, kSteps = 10'000;
  const AdamStep step = adam_step(1, 0);
  std::vector<MomentCode> codes(kRows, moment_code(0, 1, 0));
  for (int t = 1; t <= kSteps; ++t) {
    const MomentRounding rounding{7, t};
    for (std::size_t i = 0; i < kRows; ++i) {
      float parameter = 0;
      adam_update(parameter, codes[i], 0, step, AdamRule(), rounding.of_row(i));
    }
  }
  double mean = 0, squares = 0;
  for (const MomentCode code : codes) {
    const double ratio = second_moment(code) / std::pow(kAdamBeta2, kSteps);
    mean += ratio / kRows;
    squares += ratio * ratio / kRows;
  }
  // One step adds a variance of (0.47 of a step of 0.28 %)^2 at most: 13 % after 10,000. The mean
  // of 2,000 has 0.3 %.
  EXPECT_NEAR(mean, 1, 0.015);
  EXPECT_LT(std::sqrt(squares - mean * mean), 0.16);
}

TEST(MomentCode, LetsMDecayToZero) {
  const AdamStep step = adam_step(1000, 1e-3f);
  double mean = 0;
  constexpr int kRows = 4000;
  for (std::size_t i = 0; i < kRows; ++i) {
    float parameter = 0;
    MomentCode code = moment_code(1e-3f, 1e-6f, 0);
    for (int t = 1; t <= 20; ++t)
      adam_update(parameter, code, 0, step, AdamRule(), MomentRounding{1, t}.of_row(i));
    mean += first_moment(code) / (1e-3 * std::pow(kAdamBeta1, 20)) / kRows;
    for (int t = 21; t <= 1200; ++t)
      adam_update(parameter, code, 0, step, AdamRule(), MomentRounding{1, t}.of_row(i));
    ASSERT_LT(std::abs(first_moment(code)), 1e-38f);
  }
  EXPECT_NEAR(mean, 1, 2e-3);  // 20 roundings of 0.3 % each, over 4,000 rows: 0.02 %
}

// For floats the bound is sqrt(((1 - b1)^2 / (1 - b2)) / (1 - b1^2 / b2)) = 7.27, and gradients
// that grow by b2 / b1 a step come to it. One rounding changes the quotient by less than (1 + 2^-7)
// / sqrt(1 - 2^-8), so that the bound becomes 7.7.
TEST(MomentCode, KeepsTheQuotientThatMovesParametersBounded) {
  float largest = 0;
  Draws draws(4);
  const AdamStep step = adam_step(1'000'000, 1e-3f);
  for (int history = 0; history < 200; ++history) {
    const float growth = history % 2 ? 1.11f : draws.uniform(1.0f, 1.2f);
    float parameter = 0, gradient = 1e-12f;
    MomentCode code;
    for (int t = 1; t <= 300; ++t, gradient *= growth) {
      adam_update(parameter, code, gradient, step, AdamRule(), random_bits(draws));
      largest = std::max(largest, first_moment(code) / std::sqrt(second_moment(code)));
    }
  }
  EXPECT_LT(largest, 7.7f);
  EXPECT_GT(largest, 7.2f);
}

// A parameter with noisy gradients, some of which are zero: with codes it goes where it goes with
// floats, but for a noise that is small beside its way.
TEST(MomentCode, MovesParametersAsFloatsDo) {
  constexpr int kRows = 500, kSteps = 3000;
  Draws draws(5);
  double way = 0, difference = 0, error_of_v = 0;
  for (std::size_t i = 0; i < kRows; ++i) {
    float p = 0, m = 0, v = 0, by_codes = 0;
    MomentCode code;
    const float size = draws.log_uniform(1e-9f, 1e-2f);
    for (int t = 1; t <= kSteps; ++t) {
      const float gradient = draws.chance(0.5f) ? 0 : size * draws.normal();
      const AdamStep step = adam_step(t, 1e-3f);
      adam_update(p, m, v, gradient, step);
      adam_update(by_codes, code, gradient, step, AdamRule(), MomentRounding{3, t}.of_row(i));
    }
    way += double(p) * p;
    difference += (double(by_codes) - p) * (double(by_codes) - p);
    error_of_v += std::pow(second_moment(code) / v - 1, 2) / kRows;
  }
  EXPECT_LT(std::sqrt(difference / way), 0.03);
  // 0.12 % of each of the last 1,000 steps or so
  EXPECT_LT(std::sqrt(error_of_v), 0.04);
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

TEST(NumberPlaces, AreDifferentButForTheTwoRotations) {
  const NumberPlaces places = number_places();
  Gaussians rows;
  rows.has_time = rows.has_slope = true;
  std::set<int> taken;
  int numbers = 0;
  for_each_array(
      [&](const char*, const auto& array, int place) {
        for (int k = 0; k < int(sizeof(array[0]) / sizeof(float)); ++k, ++numbers)
          taken.insert(place + k);
      },
      rows, places);
  EXPECT_EQ(numbers, 68);
  EXPECT_EQ(int(taken.size()), numbers - 4);
  EXPECT_EQ(places.right_rotation, places.rotation);
}

}  // namespace
}  // namespace gs
