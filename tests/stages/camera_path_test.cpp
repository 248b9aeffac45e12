// SPDX-License-Identifier: Apache-2.0
// Orbits and tours: where they lead for cameras at known positions.
#include "gs_render/paths/camera_path.h"

#include "gs_core/math/render/rotation.h"
#include "tests/support/arc_cameras.h"
#include "tests/support/scenes.h"

namespace gs {
namespace {

TEST(LookingAt, PutsTheTargetOnTheAxisAndUpAtTheTop) {
  const Vec3d from(1.0, 2.0, 3.0), to(-4.0, 0.5, 2.0);
  const Camera camera = looking(from, to);
  const Vec3f p = multiply(camera.cam_from_world_rotation, Vec3f(to - from));
  EXPECT_NEAR(p.x, 0, 1e-5);
  EXPECT_NEAR(p.y, 0, 1e-5);
  EXPECT_GT(p.z, 0);
  const Vec3f up = multiply(camera.cam_from_world_rotation, Vec3f(kUp));
  EXPECT_NEAR(up.x, 0, 1e-6);
  EXPECT_LT(up.y, 0);
  const Quat<double> down = looking_at({0.0, 0.0, 5.0}, {0.0, 0.0, 0.0}, kUp);
  EXPECT_NEAR(squared_norm(down), 1, 1e-12);  // no pose is level here, but this is still a rotation
}

TEST(Orbit, KeepsDistanceHeightAndAim) {
  Orbit circle{scene_frame(arc(24, 1), {}), 1, {100.0, 6.0, 7.0}};
  const auto poses = orbit(circle, 36);
  ASSERT_EQ(poses.size(), 36u);
  EXPECT_LT(norm(poses[0].position - Vec3d(9.0, 6.0, 10.0)), 1e-3);  // on the side of the start
  const double step = norm(poses[1].position - poses[0].position);
  for (std::size_t i = 0; i < poses.size(); ++i) {
    const Vec3d from_center = poses[i].position - circle.frame.center;
    EXPECT_NEAR(norm(from_center), 5, 1e-4);
    EXPECT_NEAR(inner(from_center, kUp), 3, 1e-3);
    const Mat3<double> R = rotation_matrix(poses[i].world_from_cam);
    const Vec3d axis{R.row0.z, R.row1.z, R.row2.z};
    EXPECT_LT(norm(axis + from_center / norm(from_center)), 1e-9);
    EXPECT_NEAR(norm(poses[(i + 1) % 36].position - poses[i].position), step, 1e-9);  // and back
  }
  EXPECT_GT(poses[1].position.y, 6.0);  // counterclockwise, seen from above
  circle.turns = -1;
  EXPECT_LT(orbit(circle, 36)[1].position.y, 6.0);
}

TEST(Orbit, SwingsOverTheArcThatCamerasStandOn) {
  const SceneFrame frame = scene_frame(arc(24, 1), {});
  const std::vector<CameraPose> quarter = orbit({frame, 0.25, {100.0, 6.0, 7.0}}, 20);
  const CameraArc seen = arc_of_cameras(frame, quarter);
  EXPECT_NEAR(seen.width, std::numbers::pi / 2, 1e-9);
  const std::vector<CameraPose> film = orbit({frame, 1, seen.middle, seen.width}, 40);
  ASSERT_EQ(film.size(), 40u);
  const auto apart = [&](const CameraPose& a, const CameraPose& b) {
    return norm(a.position - b.position) / frame.radius;
  };
  EXPECT_LT(apart(film[10], quarter.back()), 1e-9);   // from the middle to one end,
  EXPECT_LT(apart(film[30], quarter.front()), 1e-9);  // and to the other
  EXPECT_LT(apart(film[39], film[0]), 0.2);           // and back
  EXPECT_NEAR(apart(film[0], quarter.front()), apart(film[0], quarter.back()), 1e-9);
  const double whole = arc_of_cameras(frame, orbit({frame, 1, {100.0, 6.0, 7.0}}, 12)).width;
  EXPECT_NEAR(whole, 2 * std::numbers::pi, 1e-9);
}

TEST(Orbit, OfAPartOfATurnReachesItsEnd) {
  const auto poses = orbit({scene_frame(arc(24, 1), {}), 0.5, {100.0, 6.0, 7.0}}, 11);
  EXPECT_LT(norm(poses.back().position - Vec3d(1.0, 6.0, 10.0)), 1e-3);
  EXPECT_EQ(orbit({{}, 0.25, {}}, 1).size(), 1u);
}

std::vector<CameraPose> poses_at(const std::vector<double>& xs) {
  std::vector<CameraPose> poses;
  for (const double x : xs) poses.push_back({{x, 0.0, 0.0}});
  return poses;
}

TEST(RepresentativePoses, AreTheMiddlesOfGroups) {
  EXPECT_THAT(representative_poses(poses_at({0, 1, 2, 10, 11, 12, 20, 21, 22}), 3),
              ElementsAre(1, 4, 7));
  EXPECT_THAT(representative_poses(poses_at({3, 3, 3}), 2), ElementsAre(0));
  EXPECT_EQ(representative_poses(poses_at({0, 1, 2, 3}), 9).size(), 4u);
}

TEST(RepresentativePoses, TellAttitudesApartAtOnePlace) {
  std::vector<CameraPose> poses = poses_at({0, 0, 0, 0});
  for (std::size_t i : {1, 3}) poses[i].world_from_cam = {0, 1, 0, 0};
  EXPECT_THAT(representative_poses(poses, 2), ElementsAre(0, 1));
}

TEST(ShortTour, IsTheCircleOnWhichThePosesStand) {
  std::vector<CameraPose> poses;
  Draws draws(3);
  std::vector<int> places(30);
  for (int i = 0; i < 30; ++i) places[std::size_t(i)] = i;
  for (std::size_t i = 29; i > 0; --i)
    std::swap(places[i], places[draws.below(std::uint32_t(i + 1))]);
  for (const int place : places) {
    const double angle = 2 * std::numbers::pi * place / 30;
    poses.push_back({{std::cos(angle), std::sin(angle), 0.0}});
  }
  const std::vector<std::size_t> tour = short_tour(poses);
  ASSERT_EQ(tour.size(), 30u);
  EXPECT_EQ(tour[0], 0u);
  for (std::size_t i = 0; i < 30; ++i) {
    const int apart = std::abs(places[tour[i]] - places[tour[(i + 1) % 30]]);
    EXPECT_TRUE(apart == 1 || apart == 29) << i;
  }
}

// A tour that always goes on to the nearest next camera would cross itself on the way back.
TEST(ShortTour, NoExchangeOfTwoLegsMakesItShorter) {
  for (const std::uint64_t seed : {1, 2, 3, 4, 5}) {
    Draws draws(seed);
    std::vector<CameraPose> poses;
    for (int i = 0; i < 12; ++i) poses.push_back({Vec3d(draws.uniform3(-1, 1))});
    const std::vector<std::size_t> tour = short_tour(poses);
    const auto at = [&](std::size_t i) { return poses[tour[i % tour.size()]].position; };
    for (std::size_t i = 0; i < 12; ++i)
      for (std::size_t j = i + 2; j < 12; ++j) {
        const double now = norm(at(i) - at(i + 1)) + norm(at(j) - at(j + 1));
        EXPECT_GE(norm(at(i) - at(j)) + norm(at(i + 1) - at(j + 1)), now - 1e-6);
      }
    std::vector<std::size_t> sorted = tour;
    std::sort(sorted.begin(), sorted.end());
    for (std::size_t i = 0; i < 12; ++i) EXPECT_EQ(sorted[i], i);
  }
  EXPECT_TRUE(short_tour({}).empty());
  EXPECT_THAT(short_tour(poses_at({1})), ElementsAre(0));
}

}  // namespace
}  // namespace gs
