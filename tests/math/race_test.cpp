// SPDX-License-Identifier: Apache-2.0
// The draw without replacement: its logarithm against that of long double, and the law of the draw.
#include "gs_core/math/density/race.h"

#include "tests/support/test.h"

namespace gs {
namespace {

constexpr std::uint64_t kAllBits = ~std::uint64_t(0);
constexpr double kUnit = 0x1p-40;

std::uint64_t bits_of(int draw, std::uint32_t row) {
  const RandomBits bits = Random{7, RandomStream::test}.bits(std::uint64_t(draw), row);
  return std::uint64_t(bits.word[1]) << 32 | bits.word[0];
}

/// The first k rows of the race.
std::vector<std::uint32_t> drawn(const std::vector<double>& scores, std::size_t k, int draw) {
  std::vector<std::uint64_t> keys;
  for (std::uint32_t i = 0; i < scores.size(); ++i)
    keys.push_back(race_key(bits_of(draw, i), scores[i]));
  std::vector<std::uint32_t> rows(scores.size());
  std::iota(rows.begin(), rows.end(), 0u);
  std::stable_sort(rows.begin(), rows.end(),
                   [&](std::uint32_t a, std::uint32_t b) { return keys[a] < keys[b]; });
  rows.resize(k);
  return rows;
}

TEST(MinusLog2, IsExactAtPowersOfTwo) {
  EXPECT_EQ(minus_log2(kAllBits), 0u);
  for (int power = 0; power < 64; ++power)
    EXPECT_EQ(minus_log2((std::uint64_t(1) << power) - 1), std::uint64_t(64 - power) << 40)
        << "2^" << power;
}

// Each of the 40 squarings cuts off less than 2^-62 of a mantissa, which its later doublings enlarge.
TEST(MinusLog2, IsTheLogarithmRoundedUp) {
  for (int k = 0; k < 100000; ++k) {
    const std::uint64_t bits = bits_of(k, 0) >> (k % 64);
    const long double exact = 64.0L - std::log2((long double)(bits) + 1.0L);
    const long double found = (long double)(minus_log2(bits)) * kUnit;
    EXPECT_GE(found, exact - 1e-17L) << bits;
    EXPECT_LE(found, exact + 2 * kUnit) << bits;
  }
}

TEST(MinusLog2, NeverRisesWithTheBits) {
  std::uint64_t before = minus_log2(0);
  for (std::uint64_t bits = 1; bits < kAllBits - (kAllBits >> 13); bits += kAllBits >> 13) {
    EXPECT_LE(minus_log2(bits), before);
    before = minus_log2(bits);
  }
}

// The standard error of a share p of 200,000 draws is below 0.0012.
TEST(Race, DrawsOneRowInProportionToItsScore) {
  const std::vector<double> scores{1, 0.5, 3, 1e-3, 0, 5.5};
  const double total = std::accumulate(scores.begin(), scores.end(), 0.0);
  constexpr int kDraws = 200000;
  std::vector<int> count(scores.size());
  for (int draw = 0; draw < kDraws; ++draw) ++count[drawn(scores, 1, draw)[0]];
  for (std::size_t i = 0; i < scores.size(); ++i)
    EXPECT_NEAR(double(count[i]) / kDraws, scores[i] / total, 0.005) << i;
  EXPECT_EQ(count[4], 0);
}

// Without replacement the second row is drawn in proportion among those that are left.
TEST(Race, DrawsTheSecondRowFromTheRest) {
  const std::vector<double> scores{1, 2, 3};
  constexpr int kDraws = 200000;
  int zero_then_one = 0, pairs_with_zero = 0;
  for (int draw = 0; draw < kDraws; ++draw) {
    const auto rows = drawn(scores, 2, draw);
    ASSERT_NE(rows[0], rows[1]);
    zero_then_one += rows[0] == 0 && rows[1] == 1;
    pairs_with_zero += rows[0] == 0 || rows[1] == 0;
  }
  EXPECT_NEAR(double(zero_then_one) / kDraws, 1.0 / 6 * 2 / 5, 0.004);
  EXPECT_NEAR(double(pairs_with_zero) / kDraws, 1.0 / 6 + 2.0 / 6 * 1 / 4 + 3.0 / 6 * 1 / 3, 0.005);
}

TEST(Race, NeverDrawsARowWithoutAScore) {
  const double infinity = std::numeric_limits<double>::infinity();
  for (const double score : {0.0, -1.0, std::nan(""), infinity, -infinity}) {
    EXPECT_EQ(race_key(kAllBits, score), kNeverDrawn) << score;
    EXPECT_EQ(race_key(0, score), kNeverDrawn) << score;
    EXPECT_EQ(top_key(score), kNeverDrawn) << score;
  }
}

TEST(Race, DrawsEveryRowWithAScoreBeforeThose) {
  for (const double score : {5e-324, 1e-300, 1.0, 1e300})
    for (const std::uint64_t bits : {std::uint64_t(0), std::uint64_t(12345), kAllBits}) {
      EXPECT_LT(race_key(bits, score), kNeverDrawn) << score;
      EXPECT_GT(race_key(bits, score), 0u) << score;
      EXPECT_LT(top_key(score), kNeverDrawn) << score;
    }
}

TEST(TopKey, IsSmallerForALargerScore) {
  double score = 5e-324;
  while (score < 1e307) {
    const double larger = std::nextafter(score, 1e308);
    EXPECT_LT(top_key(larger), top_key(score));
    score = larger * 1.9;
  }
}

}  // namespace
}  // namespace gs
