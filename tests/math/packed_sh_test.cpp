// SPDX-License-Identifier: Apache-2.0
#include "gs_core/math/view/packed_sh.h"

#include "tests/support/scenes.h"

namespace gs {
namespace {

constexpr int kNumbers = 3 * kShRestCount;

struct Row {
  float numbers[kNumbers];
  std::int16_t packed[kNumbers];
  float scale;

  void pack() {
    scale = packed_sh_scale(numbers, kNumbers);
    for (int k = 0; k < kNumbers; ++k) packed[k] = packed_sh(numbers[k], scale);
  }
};

Row random_row(Draws& draws, float size) {
  Row row;
  for (float& number : row.numbers) number = size * draws.normal();
  row.pack();
  return row;
}

Vec3f random_direction(Draws& draws) {
  return unit_direction(Vec3f(0.0f), Vec3f(draws.normal(), draws.normal(), draws.normal()));
}

TEST(PackedSh, ACoefficientIsOffByHalfAScaleAtMost) {
  Draws draws(1);
  for (const float size : {1e-30f, 1e-6f, 0.02f, 1.0f, 1e6f, 1e30f})
    for (int i = 0; i < 200; ++i) {
      const Row row = random_row(draws, size);
      for (int k = 0; k < kNumbers; ++k) {
        const double error = double(row.packed[k]) * row.scale - double(row.numbers[k]);
        EXPECT_LE(std::abs(error), 0.505 * double(row.scale));  // and the rounding of one division
      }
    }
}

TEST(PackedSh, TheLargestCoefficientUsesTheWholeRange) {
  Row row{};
  row.numbers[7] = -0.3f;
  row.numbers[8] = 0.1f;
  row.pack();
  EXPECT_EQ(row.packed[7], -32767);
  EXPECT_EQ(row.packed[8], 10922);
  EXPECT_EQ(row.packed[0], 0);
}

TEST(PackedSh, ZerosAndTheSmallestNumbersStaySmall) {
  Row row{};
  row.pack();
  EXPECT_EQ(row.scale, 0);
  row.numbers[3] = std::numeric_limits<float>::denorm_min();
  row.numbers[4] = -1e-40f;
  row.pack();
  for (int k = 0; k < kNumbers; ++k)
    EXPECT_LE(std::abs(float(row.packed[k]) * row.scale), 1.1e-40f) << k;
}

TEST(PackedSh, WhatIsNotFiniteHasNoColor) {
  for (const float broken :
       {std::numeric_limits<float>::quiet_NaN(), std::numeric_limits<float>::infinity(),
        -std::numeric_limits<float>::infinity()}) {
    Row row{};
    row.numbers[2] = 0.5f;
    row.numbers[20] = broken;
    row.pack();
    EXPECT_FALSE(is_finite(packed_sh_color(3, {0, 0, 1}, {1, 1, 1}, row.scale, row.packed)));
  }
}

// Half a scale of each coefficient, times the sum of the basis functions' absolute values, which is
// below 8 for degree 3.
TEST(PackedSh, ColorsAgreeWithThoseInFloat) {
  Draws draws(2);
  double squares = 0;
  int count = 0;
  for (int degree = 0; degree <= 3; ++degree)
    for (int i = 0; i < 2000; ++i) {
      const Row row = random_row(draws, 0.05f);
      const Vec3f d = random_direction(draws), sh0(draws.normal(), draws.normal(), draws.normal());
      const Vec3f expected = sh_color(degree, d, sh0, reinterpret_cast<const Vec3f*>(row.numbers));
      const Vec3f actual = packed_sh_color(degree, d, sh0, row.scale, row.packed);
      for (int c = 0; c < 3; ++c) {
        const double error = double(actual[c]) - expected[c];
        EXPECT_LE(std::abs(error), 0.5 * 8 * row.scale + 1e-6);
        squares += error * error;
        ++count;
      }
    }
  // 16 bits of coefficients with an rms of 0.05: some 109 dB for a single color of degree 3. In a
  // picture the errors of many Gaussians are averaged.
  EXPECT_GT(-10 * std::log10(squares / count), 105);
}

}  // namespace
}  // namespace gs
