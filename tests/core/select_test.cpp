// SPDX-License-Identifier: Apache-2.0
// Which Gaussians lie where, how large they are, and which way is up among them.
#include "gs_model/edit/select.h"

#include "gs_core/geometry/vectors.h"
#include "gs_model/edit/polygon.h"
#include "gs_model/edit/upright.h"
#include "tests/support/scenes.h"

namespace gs {
namespace {

/// Spheres of size 0.1 and opacity 0.5 at these places.
Gaussians spheres(const std::vector<Vec3f>& means) {
  Gaussians g(means.size(), host_memory());
  for (std::size_t i = 0; i < means.size(); ++i) set_gaussian(g, i, means[i], 0.1f, 0.5f);
  return g;
}

TEST(Select, MarkedRowsAndTheirComplement) {
  const Marks marks = marks_where(5, [](std::size_t i) { return i % 2 == 1; });
  EXPECT_THAT(rows_marked(marks), ElementsAre(1, 3));
  EXPECT_THAT(rows_marked(marks, false), ElementsAre(0, 2, 4));
}

TEST(Select, TheLargestScoresInTheirOldOrderTheFirstOfEqualOnesAndNoNan) {
  EXPECT_THAT(rows_with_largest({1, 5, kNan, 3, 5, 3}, 3), ElementsAre(1, 3, 4));
  EXPECT_THAT(rows_with_largest({1, kNan}, 9), ElementsAre(0, 1));
}

TEST(Select, ABoxHasAnyTwoOppositeCornersAndNoNan) {
  const Box box = box_between({1, -1, 4}, {-1, 1, 2});
  EXPECT_TRUE(box.holds({0, 0, 3}));
  EXPECT_TRUE(box.holds({1, 1, 2}));  // its surface belongs to it
  EXPECT_FALSE(box.holds({0, 0, 4.01}));
  EXPECT_FALSE(box.holds({double(kNan), 0, 3}));
}

TEST(Select, TheBoxOfTheMeansLeavesOutNan) {
  const Box box = box_of_means(spheres({{1, 2, 3}, {kNan, 0, 0}, {-1, 5, 3}}));
  EXPECT_EQ(box.low, Vec3d(-1, 2, 3));
  EXPECT_EQ(box.high, Vec3d(1, 5, 3));
  EXPECT_EQ(box_of_means(spheres({})).high, Vec3d(0.0));
}

TEST(Select, AnIntervalWithoutAnEndReachesInfinity) {
  Interval interval;
  interval.low = 2;
  EXPECT_TRUE(interval.holds(2));
  EXPECT_TRUE(interval.holds(std::numeric_limits<double>::infinity()));
  EXPECT_FALSE(interval.holds(1.99));
  EXPECT_FALSE(Interval().holds(double(kNan)));
}

TEST(Select, InAPictureIsInFrontAndBetweenItsEdges) {
  const Camera camera = random_camera(120, 80, 3);
  EXPECT_TRUE(is_in_picture(camera, behind_pixel(camera, 1, 1, 2)));
  EXPECT_TRUE(is_in_picture(camera, behind_pixel(camera, 119, 79, 2)));
  EXPECT_FALSE(is_in_picture(camera, behind_pixel(camera, 121, 40, 2)));
  EXPECT_FALSE(is_in_picture(camera, behind_pixel(camera, 60, -1, 2)));
  EXPECT_FALSE(is_in_picture(camera, behind_pixel(camera, 60, 40, -2)));
}

TEST(Select, TheSizeIsTheLargestStandardDeviation) {
  Gaussians g = spheres({{0, 0, 0}, {1, 0, 0}});
  g.log_scale[1] = {std::log(0.2f), std::log(3.0f), std::log(0.5f)};
  EXPECT_NEAR(sizes_of(g)[0], 0.1f, 1e-6);
  EXPECT_NEAR(sizes_of(g)[1], 3, 1e-5);
}

TEST(Select, CoverageGrowsWithOpacityAndWithTheSquareOfTheSize) {
  Gaussians g = spheres({{0, 0, 0}, {1, 0, 0}, {2, 0, 0}});
  set_gaussian(g, 1, {1, 0, 0}, 0.2f, 0.5f);
  set_gaussian(g, 2, {2, 0, 0}, 0.1f, 0.25f);
  const std::vector<float> coverage = coverages_of(g);
  EXPECT_NEAR(coverage[1] / coverage[0], 4, 1e-4);
  EXPECT_NEAR(coverage[2] / coverage[0], 0.5, 1e-4);
}

TEST(Select, DistancesAreToTheNearestPosition) {
  const Gaussians g = spheres({{0, 0, 0}, {10, 0, 0}});
  EXPECT_THAT(distances_to_nearest(g, {{3, 0, 4}, {10, 2, 0}}), ElementsAre(5, 2));
  EXPECT_THAT(distances_to_nearest(g, {}), testing::Each(INFINITY));
}

TEST(Polygon, ARingWithinARingIsAHole) {
  const Polygon area({{{0, 0}, {4, 0}, {4, 4}, {0, 4}}, {{1, 1}, {3, 1}, {3, 3}, {1, 3}}});
  EXPECT_TRUE(area.holds({0.5, 2}));
  EXPECT_FALSE(area.holds({2, 2}));
  EXPECT_FALSE(area.holds({5, 2}));
  EXPECT_FALSE(area.holds({-1, 2}));
}

TEST(Polygon, AHalfLineThroughAVertexCrossesOnce) {
  const Polygon kite({{{0, 0}, {2, 1}, {0, 2}, {-2, 1}}});
  EXPECT_TRUE(kite.holds({0, 1}));
  EXPECT_FALSE(kite.holds({-3, 1}));
  EXPECT_FALSE(kite.holds({3, 1}));
  EXPECT_FALSE(kite.holds({-1, 2}));
}

// A floor with a table on it, a wall, and things at random, tilted about z.
Gaussians tilted_room(double tilt) {
  Draws draws(4);
  std::vector<Vec3f> means;
  const auto add = [&](const Vec3f& p) {
    const float c = float(std::cos(tilt)), s = float(std::sin(tilt));
    means.push_back({c * p.x - s * p.y, s * p.x + c * p.y, p.z});
  };
  for (int i = 0; i < 600; ++i) add({draws.uniform(-2, 2), 1, draws.uniform(-2, 2)});
  for (int i = 0; i < 100; ++i) add({draws.uniform(-1, 0), 0.3f, draws.uniform(-1, 0)});
  for (int i = 0; i < 900; ++i) add({2, draws.uniform(-1, 1), draws.uniform(-2, 2)});
  for (int i = 0; i < 300; ++i) add(draws.uniform3(-1, 1));
  return spheres(means);
}

TEST(Upright, LevelSurfacesSayWhichWayIsUpAndWallsDoNot) {
  for (const double degrees : {0.0, 20.0, -30.0}) {
    const double tilt = degrees * M_PI / 180;
    const Vec3d up = up_of_levels(tilted_room(tilt));
    EXPECT_NEAR(up.x, std::sin(tilt), 0.01) << degrees;
    EXPECT_NEAR(up.y, -std::cos(tilt), 0.01) << degrees;
    EXPECT_NEAR(up.z, 0, 0.01) << degrees;
  }
}

TEST(Upright, AWallThatIsMostOfAModelDoesNotSayWhichWayIsUp) {
  Draws draws(5);
  std::vector<Vec3f> means;  // leaning by 60 degrees
  for (int i = 0; i < 900; ++i) {
    const float a = draws.uniform(-2, 2), b = draws.uniform(-2, 2);
    means.push_back({a, 0.87f * b, 0.5f * b});
  }
  EXPECT_EQ(up_of_levels(spheres(means)), Vec3d(0, -1, 0));
}

TEST(Upright, WithoutGaussiansThatCountUpIsMinusY) {
  EXPECT_EQ(up_of_levels(spheres({})), Vec3d(0, -1, 0));
  EXPECT_EQ(up_of_levels(spheres({{1, 2, 3}})), Vec3d(0, -1, 0));
  EXPECT_EQ(up_of_levels(spheres({{kNan, 2, 3}})), Vec3d(0, -1, 0));
}

TEST(Upright, TheFloorIsTheLowestOfWhatIsNearAndNotFaint) {
  std::vector<Vec3f> means;
  for (int i = 0; i < 100; ++i) means.push_back({0, i < 90 ? 1.0f : 0.0f, 0.01f * float(i)});
  means.push_back({0, 500, 0});  // far below
  Gaussians g = spheres(means);
  EXPECT_NEAR(floor_height(g, {0, -1, 0}, {0, 0, 0}, 10), -1, 1e-6);
  for (std::size_t i = 0; i < 90; ++i) g.logit_opacity[i] = -5;  // fog
  EXPECT_NEAR(floor_height(g, {0, -1, 0}, {0, 0, 0}, 10), 0, 1e-6);
  EXPECT_EQ(floor_height(spheres({}), {0, -1, 0}, {0, 0, 0}, 10), 0);
}

}  // namespace
}  // namespace gs
