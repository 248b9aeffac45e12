// SPDX-License-Identifier: Apache-2.0
// Space in parts: every point is in exactly one, and the parts have equal shares of the points.
#include "gs_core/geometry/cut_tree.h"

#include "gs_core/geometry/vectors.h"
#include "gs_core/math/random.h"
#include "tests/support/test.h"

namespace gs {
namespace {

Vec3d draw(std::uint32_t i, std::uint32_t use) {
  const Vec4f n = Random{3, RandomStream::test}.normal4(i, use);
  return {double(n.x), double(n.y), double(n.z)};
}

/// Points of a flat town, 60 by 20 units, with a few far away.
std::vector<Vec3d> town(std::uint32_t count) {
  std::vector<Vec3d> points;
  for (std::uint32_t i = 0; i < count; ++i)
    points.push_back(draw(i, 0) * (i % 50 == 0 ? 1000.0 : 1.0) * Vec3d(30.0, 1.0, 10.0));
  return points;
}

const std::array<Vec3d, 2> kGround{Vec3d(1.0, 0.0, 0.0), Vec3d(0.0, 0.0, 1.0)};

std::vector<std::size_t> counts_of(const CutTree& tree, const std::vector<Vec3d>& points) {
  std::vector<std::size_t> counts(tree.parts());
  for (const Vec3d& p : points) ++counts.at(tree.part_of(p));
  return counts;
}

bool bounds_hold(const CutTree& tree, std::size_t part, const Vec3d& p) {
  return std::ranges::all_of(tree.bounds_of(part),
                             [&](const WideHalfSpace& bound) { return bound.holds(p); });
}

TEST(CutTree, PartsHaveTheSameNumberOfPoints) {
  const std::vector<Vec3d> points = town(7000);
  for (const std::size_t parts : {1, 2, 3, 5, 7, 16})
    for (const std::size_t count : counts_of(divide(points, kGround, parts), points))
      EXPECT_NEAR(double(count), 7000.0 / double(parts), 4) << parts;
}

TEST(CutTree, EveryPlaceIsInTheBoundsOfItsPartAndOfNoOther) {
  for (const std::size_t parts : {2, 3, 6, 13}) {
    const CutTree tree = divide(town(2000), kGround, parts);
    for (std::uint32_t i = 0; i < 3000; ++i) {
      const Vec3d p = draw(i, 1) * Vec3d(80.0, 5.0, 40.0);  // none of them on a plane
      for (std::size_t part = 0; part < parts; ++part)
        EXPECT_EQ(bounds_hold(tree, part, p), part == tree.part_of(p)) << part;
    }
  }
}

TEST(CutTree, PointsOnAPlaneAreAboveIt) {
  const CutTree tree = divide(town(500), kGround, 2);
  const Cut& cut = tree.cuts.at(0);
  EXPECT_EQ(tree.part_of(cut.offset * cut.normal), 1u);
  EXPECT_EQ(tree.part_of(std::nextafter(cut.offset, -1e9) * cut.normal), 0u);
}

TEST(CutTree, APlaceThatIsNoNumberIsInSomePart) {
  const double nan = std::numeric_limits<double>::quiet_NaN();
  EXPECT_LT(divide(town(500), kGround, 6).part_of({nan, nan, nan}), 6u);
}

TEST(CutTree, CutsAreAcrossTheLongerSideAndFewPlanesAreAroundAPart) {
  const CutTree tree = divide(town(4000), kGround, 16);
  EXPECT_EQ(tree.cuts.at(0).normal, kGround[0]);
  std::size_t most = 0;
  for (std::size_t part = 0; part < 16; ++part) most = std::max(most, tree.bounds_of(part).size());
  EXPECT_EQ(most, 4u);  // one on each side
}

TEST(CutTree, FindsTheAxesOfATownThatStandsAskew) {
  const Vec3d up = unit(Vec3d(0.3, -0.9, 0.2)), side = unit(cross(up, Vec3d(1.0, 0.0, 0.3)));
  std::vector<Vec3d> points;
  for (const Vec3d& p : town(3000)) points.push_back(p.x * side + p.y * up + p.z * cross(side, up));
  const auto [first, second] = ground_axes(up, points);
  EXPECT_NEAR(std::abs(inner(first, side)), 1, 1e-2);
  EXPECT_NEAR(inner(first, up), 0, 1e-12);
  EXPECT_NEAR(inner(second, up), 0, 1e-12);
  EXPECT_NEAR(inner(first, second), 0, 1e-12);
  EXPECT_NEAR(length(first), 1, 1e-12);
}

TEST(CutTree, PointsInOnePlaceLeaveAPartEmpty) {
  const std::vector<Vec3d> points(10, Vec3d(1.0, 2.0, 3.0));
  const std::vector<std::size_t> counts = counts_of(divide(points, kGround, 2), points);
  EXPECT_EQ(std::ranges::min(counts), 0u);
}

TEST(CutTree, TreesThatAreNoneAreFound) {
  const CutTree good = divide(town(500), kGround, 4);
  EXPECT_TRUE(good.is_whole());
  EXPECT_TRUE(CutTree().is_whole());
  CutTree twice = good, circle = good, outside = good;
  twice.cuts[2].below = twice.cuts[1].below;
  circle.cuts[2].below = {true, 0};
  outside.cuts[1].above = {false, 4};
  EXPECT_FALSE(twice.is_whole());
  EXPECT_FALSE(circle.is_whole());
  EXPECT_FALSE(outside.is_whole());
}

TEST(CutTree, WithoutPointsThereAreCutsAllTheSame) {
  EXPECT_EQ(divide({}, kGround, 3).parts(), 3u);
  EXPECT_EQ(reach_along(kGround[0], {}), 0);
}

}  // namespace
}  // namespace gs
