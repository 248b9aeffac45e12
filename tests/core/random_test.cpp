// SPDX-License-Identifier: Apache-2.0
#include "gs_core/math/random.h"

#include "tests/support/test.h"

namespace gs {
namespace {

constexpr int kBlocks = 250'000;  // of four numbers: a million draws
constexpr Random kRandom{42, RandomStream::test};

std::array<std::uint32_t, 4> words(const RandomBits& bits) {
  return {bits.word[0], bits.word[1], bits.word[2], bits.word[3]};
}
using Words = std::array<std::uint32_t, 4>;

// The known answers that come with Random123 (Salmon et al. 2011).
TEST(Philox, GivesTheKnownAnswers) {
  EXPECT_EQ(words(philox({{0, 0, 0, 0}}, 0, 0)),
            (Words{0x6627e8d5u, 0xe169c58du, 0xbc57ac4cu, 0x9b00dbd8u}));
  EXPECT_EQ(words(philox({{~0u, ~0u, ~0u, ~0u}}, ~0u, ~0u)),
            (Words{0x408f276du, 0x41c83b0eu, 0xa20bc7c6u, 0x6d5451fdu}));
  EXPECT_EQ(words(philox({{0x243f6a88u, 0x85a308d3u, 0x13198a2eu, 0x03707344u}}, 0xa4093822u,
                         0x299f31d0u)),
            (Words{0xd16cfe09u, 0x94fdcceb, 0x5001e420u, 0x24126ea1u}));
}

TEST(Random, DependsOnEachOfSeedStreamAndBothCounters) {
  const auto at = [](std::uint64_t seed, RandomStream stream, std::uint64_t major,
                     std::uint32_t minor) {
    return words(Random{seed, stream}.bits(major, minor));
  };
  const std::vector<Words> draws = {at(1, RandomStream::test, 1, 1),
                                    at(2, RandomStream::test, 1, 1),
                                    at(1 + (1ull << 32), RandomStream::test, 1, 1),
                                    at(1, RandomStream::split_gaussians, 1, 1),
                                    at(1, RandomStream::test, 2, 1),
                                    at(1, RandomStream::test, 1 + (1ull << 32), 1),
                                    at(1, RandomStream::test, 1, 2)};
  for (std::size_t i = 0; i < draws.size(); ++i) {
    for (std::size_t j = 0; j < i; ++j) EXPECT_NE(draws[i], draws[j]) << i << " " << j;
  }
}

TEST(Random, GivesTheSameNumbersInAnyOrderOfCalls) {
  const Words first = words(kRandom.bits(7, 3));
  kRandom.bits(8, 1);
  EXPECT_EQ(words(kRandom.bits(7, 3)), first);
}

/// Moments of a million numbers.
struct Moments {
  double mean = 0.0, variance = 0.0, lag = 0.0;  // lag: mean product of neighbors in a block
  float smallest = 1e30f, largest = -1e30f;
};
template <class Draw>
Moments moments(const Draw& draw, double center) {
  Moments m;
  for (int i = 0; i < kBlocks; ++i) {
    const Vec4f v = draw(std::uint64_t(i));
    for (int k = 0; k < 4; ++k) {
      m.mean += v[k] / (4.0 * kBlocks);
      m.variance += (v[k] - center) * (v[k] - center) / (4.0 * kBlocks);
      m.lag += (v[k] - center) * (v[(k + 1) % 4] - center) / (4.0 * kBlocks);
      m.smallest = std::min(m.smallest, v[k]);
      m.largest = std::max(m.largest, v[k]);
    }
  }
  return m;
}

// Tolerances are four standard errors of a million draws.
TEST(Uniform4, LiesInsideTheOpenUnitIntervalWithItsMoments) {
  const Moments m = moments([](std::uint64_t i) { return kRandom.uniform4(i); }, 0.5);
  EXPECT_GT(m.smallest, 0.0f);
  EXPECT_LT(m.largest, 1.0f);
  EXPECT_NEAR(m.mean, 0.5, 0.0012);
  EXPECT_NEAR(m.variance, 1.0 / 12.0, 0.0003);
  EXPECT_NEAR(m.lag, 0.0, 0.00034);
}

TEST(Normal4, HasTheMomentsOfTheStandardNormal) {
  const Moments m = moments([](std::uint64_t i) { return kRandom.normal4(i); }, 0.0);
  EXPECT_NEAR(m.mean, 0.0, 0.004);
  EXPECT_NEAR(m.variance, 1.0, 0.0057);
  EXPECT_NEAR(m.lag, 0.0, 0.004);
}

// Shares within one and two standard deviations: 68.27 % and 95.45 %.
TEST(Normal4, HasTheTailsOfTheStandardNormal) {
  int one = 0, two = 0;
  for (int i = 0; i < kBlocks; ++i) {
    const Vec4f v = kRandom.normal4(std::uint64_t(i));
    for (int k = 0; k < 4; ++k) {
      one += std::abs(v[k]) < 1.0f;
      two += std::abs(v[k]) < 2.0f;
    }
  }
  EXPECT_NEAR(one / (4.0 * kBlocks), 0.6827, 0.002);
  EXPECT_NEAR(two / (4.0 * kBlocks), 0.9545, 0.001);
}

// Pearson's chi-square of 1e6 draws into 10 classes: mean 9, and above 40 once in 100,000 times.
TEST(Below, CoversItsRangeEvenly) {
  constexpr int kDraws = 1'000'000, kClasses = 10;
  std::array<int, kClasses> counts{};
  for (int i = 0; i < kDraws; ++i) {
    const std::uint32_t value = kRandom.below(kClasses, std::uint64_t(i));
    ASSERT_LT(value, std::uint32_t(kClasses));
    ++counts[value];
  }
  const double expected = double(kDraws) / kClasses;
  double chi_square = 0.0;
  for (const int n : counts) chi_square += (n - expected) * (n - expected) / expected;
  EXPECT_LT(chi_square, 40.0);
}

TEST(Below, OneIsAlwaysZero) {
  for (int i = 0; i < 100; ++i) EXPECT_EQ(kRandom.below(1, std::uint64_t(i)), 0u);
}

#ifdef __SIZEOF_INT128__
TEST(HighProduct, IsTheUpperHalfOf128Bits) {
  const std::uint64_t some[] = {
      0, 1, 0xffffffffu, 0x100000000u, 0x123456789abcdef0u, ~std::uint64_t(0)};
  for (const std::uint64_t a : some)
    for (const std::uint64_t b : some) {
      __extension__ typedef unsigned __int128 Wide;
      EXPECT_EQ(high_product(a, b), std::uint64_t(Wide(a) * b >> 64)) << a << " " << b;
    }
}
#endif

TEST(Random, Below64StaysBelowAndFillsItsRange) {
  const Random random{3, RandomStream::test};
  const std::uint64_t bound = (std::uint64_t(1) << 52) + 12345;
  double mean = 0;
  for (int i = 0; i < 10000; ++i) {
    const std::uint64_t value = random.below64(bound, std::uint64_t(i));
    EXPECT_LT(value, bound);
    mean += double(value) / double(bound) / 10000;
  }
  EXPECT_NEAR(mean, 0.5, 0.012);  // four standard errors
  EXPECT_EQ(random.below64(1, 7), 0u);
}

}  // namespace
}  // namespace gs
