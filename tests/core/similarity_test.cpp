// SPDX-License-Identifier: Apache-2.0
// Similarities between two sets of positions, exact, noisy and with wrong pairs.
#include "gs_core/geometry/similarity.h"

#include "gs_core/geometry/vectors.h"
#include "gs_core/math/random.h"
#include "gs_core/math/render/rotation.h"
#include "tests/support/test.h"

namespace gs {
namespace {

const Similarity kTruth{12.5, rotation_matrix(Quat<double>{0.3, -0.5, 0.1, 0.8}),
                        Vec3d(4.1e6, 1.1e6, 4.7e6)};

Vec3d normal(std::uint32_t i, std::uint32_t use) {
  const Vec4f n = Random{11, RandomStream::test}.normal4(i, use);
  return {double(n.x), double(n.y), double(n.z)};
}

/// `count` positions in a flat box, and where the truth takes them, with noise.
struct Sets {
  std::vector<Vec3d> from, to;

  explicit Sets(std::uint32_t count, double noise = 0) {
    for (std::uint32_t i = 0; i < count; ++i) {
      from.push_back(normal(i, 0) * Vec3d(4.0, 3.0, 0.2));
      to.push_back(kTruth(from.back()) + noise * normal(i, 1));
    }
  }
};

/// The largest distance between what two similarities make of positions within 10 units.
double difference(const Similarity& a, const Similarity& b) {
  double largest = 0;
  for (const double x : {-10.0, 10.0})
    for (const double y : {-10.0, 10.0})
      for (const double z : {-10.0, 10.0})
        largest = std::max(largest, length(a(Vec3d(x, y, z)) - b(Vec3d(x, y, z))));
  return largest;
}

TEST(Similarity, ExactPairsGiveTheTruth) {
  const Sets sets(6);
  const auto found = fit_similarity(sets.from, sets.to);
  ASSERT_TRUE(found);
  EXPECT_TRUE(is_rotation(found->R, 1e-12));
  EXPECT_LT(difference(*found, kTruth), 1e-6);  // doubles at 6e6 have steps of 1e-9
}

TEST(Similarity, NoNearbySimilarityHasSmallerDistances) {
  const Sets sets(30, 2);
  const auto found = fit_similarity(sets.from, sets.to);
  ASSERT_TRUE(found);
  const auto cost = [&](const Similarity& s) {
    double sum = 0;
    for (std::size_t i = 0; i < sets.from.size(); ++i) {
      const Vec3d d = s(sets.from[i]) - sets.to[i];
      sum += inner(d, d);
    }
    return sum;
  };
  const double least = cost(*found);
  for (const double sign : {-1.0, 1.0})
    for (int axis = 0; axis < 3; ++axis) {
      Similarity moved = *found, turned = *found, scaled = *found;
      moved.shift[axis] += sign * 0.1;
      Quat<double> small{1, 0, 0, 0};
      (axis == 0 ? small.x : axis == 1 ? small.y : small.z) = sign * 0.01;
      const Mat3<double> turn = rotation_matrix(small);
      const Mat3<double>& R = found->R;
      for (auto [row, by] : {std::pair{&turned.R.row0, turn.row0},
                             {&turned.R.row1, turn.row1},
                             {&turned.R.row2, turn.row2}})
        *row = by.x * R.row0 + by.y * R.row1 + by.z * R.row2;
      Vec3d center(0.0);
      for (const Vec3d& at : sets.from) center += at / double(sets.from.size());
      turned.shift += (*found)(center)-turned(center);
      scaled.scale *= 1 + sign * 0.01;
      scaled.shift += (*found)(center)-scaled(center);
      EXPECT_GT(cost(moved), least);
      EXPECT_GT(cost(turned), least);
      EXPECT_GT(cost(scaled), least);
    }
}

TEST(Similarity, MirroredPairsNeverGiveAMirror) {
  Sets sets(20);
  for (Vec3d& at : sets.from) at.x = -at.x;
  const auto found = fit_similarity(sets.from, sets.to);
  EXPECT_TRUE(!found || is_rotation(found->R, 1e-9));
  const auto robust = fit_robust_similarity(sets.from, sets.to, {0.01});
  EXPECT_TRUE(!robust || robust->fit_count < 10);
}

TEST(Similarity, PositionsOnALineAreRefused) {
  std::vector<Vec3d> from, to;
  for (int i = 0; i < 10; ++i) {
    from.push_back(Vec3d(1.0, 2.0, 3.0) * double(i));
    to.push_back(kTruth(from.back()));
  }
  EXPECT_FALSE(fit_similarity(from, to));
  EXPECT_FALSE(fit_robust_similarity(from, to, {1}));
  EXPECT_FALSE(fit_similarity({from[0], Vec3d(1.0, 0.0, 0.0)}, {to[0], to[1]}));
}

TEST(RobustSimilarity, WrongPairsChangeNothing) {
  for (const std::uint32_t count : {12u, 60u}) {
    Sets sets(count);
    for (std::uint32_t i = 0; i < count; i += 3) sets.to[i] += 80.0 * normal(i, 2);
    const auto found = fit_robust_similarity(sets.from, sets.to, {5});
    ASSERT_TRUE(found);
    EXPECT_LT(difference(found->to_from_from, kTruth), 1e-5);
    EXPECT_EQ(found->fit_count, count - (count + 2) / 3);
    for (std::uint32_t i = 0; i < count; ++i) EXPECT_EQ(found->fits[i], i % 3 != 0);
  }
}

TEST(RobustSimilarity, NoiseIsAveragedAndItsSizeIsFound) {
  Sets sets(200, 1.5);
  for (std::uint32_t i = 0; i < 200; i += 5) sets.to[i] += 500.0 * normal(i, 2);
  const auto found = fit_robust_similarity(sets.from, sets.to, {6});
  ASSERT_TRUE(found);
  EXPECT_NEAR(found->rms, 1.5 * std::sqrt(3.0), 0.3);
  EXPECT_LT(length(found->to_from_from(Vec3d(0.0)) - kTruth(Vec3d(0.0))), 0.5);
  EXPECT_LT(std::abs(found->to_from_from.scale / kTruth.scale - 1), 0.01);
  // A turn of this size is what the errors allow: 160 pairs some 37 units off their line.
  EXPECT_NEAR(found->turn_error, 1.5 / std::sqrt(160.0) / (12.5 * 3), 0.002);
}

TEST(RobustSimilarity, TheSameSeedGivesTheSameResult) {
  const Sets sets(200, 1.5);
  const auto first = fit_robust_similarity(sets.from, sets.to, {4});
  const auto again = fit_robust_similarity(sets.from, sets.to, {4});
  ASSERT_TRUE(first && again);
  EXPECT_EQ(first->to_from_from.shift, again->to_from_from.shift);
  EXPECT_EQ(first->fits, again->fits);
}

TEST(RobustSimilarity, PairsThatDoNotAgreeGiveNone) {
  Sets sets(3);
  EXPECT_TRUE(fit_robust_similarity(sets.from, sets.to, {0.01}));
  sets.to[0] += Vec3d(0.0, 0.0, 300.0);
  EXPECT_FALSE(fit_robust_similarity(sets.from, sets.to, {0.01}));
}

}  // namespace
}  // namespace gs
