// SPDX-License-Identifier: Apache-2.0
#include "gs_core/geometry/kd_tree.h"

#include "tests/support/scenes.h"

namespace gs {
namespace {

/// The same mean, computed from every point and added up in the same order, so that it has the same
/// bits.
float mean_by_brute_force(const std::vector<Vec3f>& points, std::size_t i, int k) {
  std::vector<float> distances;
  for (std::size_t other = 0; other < points.size(); ++other) {
    const Vec3f offset = points[other] - points[i];
    if (other != i) distances.push_back(inner(offset, offset));
  }
  std::sort(distances.begin(), distances.end());
  const std::size_t found = std::min(distances.size(), std::size_t(k));
  float sum = 0;
  for (std::size_t n = 0; n < found; ++n) sum += distances[n];
  return found ? sum / float(found) : 0;
}

void expect_brute_force(std::vector<Vec3f> points) {
  const KdTree tree({points.data(), points.size()});
  for (const int k : {1, 3, 8})
    for (std::size_t i = 0; i < points.size(); ++i)
      ASSERT_EQ(tree.mean_squared_distance(i, k), mean_by_brute_force(points, i, k))
          << i << " " << k;
}

std::vector<Vec3f> random_points(std::size_t count, std::uint64_t seed) {
  Draws draws(seed);
  std::vector<Vec3f> points(count);
  for (Vec3f& point : points) point = draws.uniform3(-2, 3);
  return points;
}

TEST(KdTree, FindsTheNeighborsOfBruteForceAmongRandomPoints) {
  for (const std::size_t count : {2, 3, 4, 9, 1000})
    expect_brute_force(random_points(count, count));
}

TEST(KdTree, FindsThemOnALineAndInAPlane) {
  std::vector<Vec3f> line = random_points(300, 1), plane = random_points(300, 2);
  for (Vec3f& point : line) point.y = point.z = 0.5f;
  for (Vec3f& point : plane) point.y = -1;
  expect_brute_force(line);
  expect_brute_force(plane);
}

TEST(KdTree, FindsThemOnAGridWhereManyAreEquallyFar) {
  std::vector<Vec3f> grid;
  for (int i = 0; i < 512; ++i)
    grid.push_back(Vec3f(float(i % 8), float(i / 8 % 8), float(i / 64)));
  expect_brute_force(grid);
}

TEST(KdTree, CountsDuplicatesAsNeighborsAtDistanceZero) {
  std::vector<Vec3f> points = random_points(100, 3);
  const std::vector<Vec3f> copy = points;
  points.insert(points.end(), copy.begin(), copy.end());
  points.insert(points.end(), 20, copy[0]);
  expect_brute_force(points);
}

TEST(KdTree, SaysZeroForALonePoint) {
  const Vec3f point(1.0f);
  EXPECT_EQ(KdTree({&point, 1}).mean_squared_distance(0, 3), 0.0f);
}

}  // namespace
}  // namespace gs
