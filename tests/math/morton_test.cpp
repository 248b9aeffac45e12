// SPDX-License-Identifier: Apache-2.0
#include "gs_core/math/density/morton.h"

#include "tests/support/test.h"

namespace gs {
namespace {

const Vec3f kOrigin{0.0f, 0.0f, 0.0f};
constexpr std::uint64_t kEveryThird = 0x1249249249249249ull;  // 21 bits, 3 apart
constexpr std::uint64_t kAll = (1ull << 63) - 1;

TEST(SpreadBits, PutsBitKAtThreeK) {
  std::mt19937 random(5);
  for (int i = 0; i < 1000; ++i) {
    const std::uint64_t v = random() & 0x1fffff;
    std::uint64_t expected = 0;
    for (int k = 0; k < 21; ++k) expected |= ((v >> k) & 1) << (3 * k);
    EXPECT_EQ(spread_bits(v), expected) << v;
  }
}

TEST(SpreadBits, IgnoresHigherBits) { EXPECT_EQ(spread_bits(~0ull), kEveryThird); }

TEST(MortonCode, OfTheCornersFillsTheBitsOfTheirAxes) {
  const Vec3f low{-1.0f, 2.0f, 5.0f};
  EXPECT_EQ(morton_code({-1.0f, 2.0f, 5.0f}, low, 4.0f), 0u);
  EXPECT_EQ(morton_code({3.0f, 2.0f, 5.0f}, low, 4.0f), kEveryThird);
  EXPECT_EQ(morton_code({-1.0f, 6.0f, 5.0f}, low, 4.0f), kEveryThird << 1);
  EXPECT_EQ(morton_code({-1.0f, 2.0f, 9.0f}, low, 4.0f), kEveryThird << 2);
  EXPECT_EQ(morton_code({3.0f, 6.0f, 9.0f}, low, 4.0f), kAll);
}

TEST(MortonCode, GrowsAlongEachAxis) {
  std::uint64_t before = 0;
  for (int i = 1; i <= 1000; ++i) {
    const std::uint64_t code = morton_code({0.3f, float(i) / 1000.0f, 0.6f}, kOrigin, 1.0f);
    EXPECT_GT(code, before);
    before = code;
  }
}

TEST(MortonCode, MovesPointsOutsideToTheSurface) {
  const float infinity = std::numeric_limits<float>::infinity();
  EXPECT_EQ(morton_code({-5.0f, -infinity, -1e38f}, kOrigin, 1.0f), 0u);
  EXPECT_EQ(morton_code({5.0f, infinity, 1e38f}, kOrigin, 1.0f), kAll);
}

TEST(MortonCode, TakesNanForTheLowestCell) {
  const float nan = std::numeric_limits<float>::quiet_NaN();
  EXPECT_EQ(morton_code({nan, nan, nan}, kOrigin, 1.0f), 0u);
}

TEST(IntervalOfLife, IsHalfAsLongAsTheScaleAtMost) {
  for (const float scale : {3.0f, 2.0f, 1.5f, 0.8f, 0.11f, 0.02f, 0.004f}) {
    SCOPED_TRACE(scale);
    for (const float time : {0.0f, 0.3f, 0.77f, 1.0f}) {
      const std::uint32_t number = interval_of_life(time, std::log(scale));
      const int level = std::bit_width(number) - 1;
      const double length = std::ldexp(1.0, -level);
      EXPECT_LE(length, 0.5001 * scale);
      if (scale < 2) {
        EXPECT_GT(length, 0.2499 * scale);
      }
      EXPECT_GE(time, (number - (1u << level)) * length);
      EXPECT_LE(time, (number - (1u << level) + 1) * length);
    }
  }
}

TEST(IntervalOfLife, TakesAnyNumbers) {
  const float nan = std::numeric_limits<float>::quiet_NaN();
  const float infinity = std::numeric_limits<float>::infinity();
  const std::uint32_t most = 2u << kMostTimeHalvings;
  EXPECT_EQ(interval_of_life(nan, 5), 1u);
  EXPECT_EQ(interval_of_life(0.4f, nan), 1u);
  EXPECT_EQ(interval_of_life(-infinity, -infinity), most / 2);
  EXPECT_EQ(interval_of_life(7, -infinity), most - 1);
}

TEST(SpacetimeCode, PutsTheIntervalBeforeThePlace) {
  const float scale = std::log(0.1f);
  EXPECT_LT(spacetime_code(kAll, 0.45f, scale), spacetime_code(0, 0.55f, scale));
  EXPECT_LT(spacetime_code(0, 0.45f, scale), spacetime_code(kAll, 0.45f, scale));
  EXPECT_LT(spacetime_code(kAll, 1, -20), 1ull << 63);
}

}  // namespace
}  // namespace gs
