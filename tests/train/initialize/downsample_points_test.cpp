// SPDX-License-Identifier: Apache-2.0
#include "gs_train/initialize/downsample_points.h"

#include "tests/support/scenes.h"

namespace gs {
namespace {

std::vector<ScenePoint> cloud(std::size_t count, std::uint64_t seed) {
  Draws draws(seed);
  std::vector<ScenePoint> points(count);
  for (std::size_t i = 0; i < count; ++i)
    points[i] = {draws.uniform3(-3, 5), {std::uint8_t(i), std::uint8_t(i >> 8), 0}};
  return points;
}

float distance2(const Vec3f& a, const Vec3f& b) { return inner(a - b, a - b); }

TEST(Downsampled, LeavesAFewPointsAsTheyAre) {
  const std::vector<ScenePoint> points = cloud(100, 1), same = downsampled(points, 100);
  ASSERT_EQ(same.size(), 100u);
  for (std::size_t i = 0; i < 100; ++i) EXPECT_EQ(same[i].position, points[i].position);
}

// The sides of the cubes are halved, so at most eight times as many points could have been kept.
TEST(Downsampled, KeepsTheBudgetAndUsesIt) {
  for (const std::size_t budget : {10u, 500u, 3000u}) {
    const std::size_t kept = downsampled(cloud(20'000, 2), budget).size();
    EXPECT_LE(kept, budget);
    EXPECT_GE(8 * kept, budget);
  }
}

TEST(Downsampled, KeepsPointsInTheirOrderWithTheirColors) {
  const std::vector<ScenePoint> points = cloud(5'000, 3), kept = downsampled(points, 700);
  std::size_t from = 0;
  for (const ScenePoint& point : kept) {
    while (from < points.size() && points[from].position != point.position) ++from;
    ASSERT_LT(from, points.size());
    EXPECT_EQ(point.color, points[from].color);
  }
}

// A dense corner is downsampled to the density of the rest: every point has a kept one nearby.
TEST(Downsampled, CoversWhatItLeavesOut) {
  std::vector<ScenePoint> points = cloud(2'000, 4);
  for (ScenePoint point : cloud(50'000, 5)) {
    point.position = Vec3f(4) + 0.01f * point.position;
    points.push_back(point);
  }
  const std::vector<ScenePoint> kept = downsampled(points, 1'500);
  const auto in_corner = [](const ScenePoint& p) {
    return distance2(p.position, Vec3f(4)) < 0.01f;
  };
  EXPECT_LT(std::count_if(kept.begin(), kept.end(), in_corner), 20);
  EXPECT_GT(kept.size(), 500u);
  for (std::size_t i = 0; i < points.size(); i += 97) {
    float nearest = std::numeric_limits<float>::max();
    for (const ScenePoint& point : kept)
      nearest = std::min(nearest, distance2(point.position, points[i].position));
    EXPECT_LT(nearest, 3.0f);  // less than two cubes of a grid of 8 x 8 x 8 in a box of 8
  }
}

TEST(Downsampled, DropsWhatIsNowhere) {
  std::vector<ScenePoint> points = cloud(50, 6);
  points[7].position.y = std::numeric_limits<float>::quiet_NaN();
  points[9].position.x = std::numeric_limits<float>::infinity();
  for (const ScenePoint& point : downsampled(points, 40)) EXPECT_TRUE(is_finite(point.position));
}

TEST(Downsampled, OfManyPointsAtOnePlaceIsOne) {
  const std::vector<ScenePoint> points(1'000, ScenePoint{{1, 2, 3}, {4, 5, 6}});
  EXPECT_EQ(downsampled(points, 10).size(), 1u);
}

}  // namespace
}  // namespace gs
