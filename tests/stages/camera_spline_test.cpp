// SPDX-License-Identifier: Apache-2.0
// The curve that films follow: it passes its keys, without jumps in position, speed or rotation.
#include "gs_render/paths/camera_spline.h"

#include "gs_core/math/render/rotation.h"
#include "tests/support/scenes.h"

namespace gs {
namespace {

double norm(const Vec3d& v) { return std::sqrt(inner(v, v)); }

Quat<double> unit(const Quatf& single) {
  const Quat<double> q{single.w, single.x, single.y, single.z};
  const double n = std::sqrt(squared_norm(q));
  return {q.w / n, q.x / n, q.y / n, q.z / n};
}

/// Random poses at uneven distances, whose quaternions have either sign.
std::vector<CameraPose> random_keys(int count, std::uint64_t seed) {
  Draws draws(seed);
  std::vector<CameraPose> keys;
  for (int i = 0; i < count; ++i) {
    const float reach = draws.log_uniform(0.1f, 10);
    keys.push_back({Vec3d(draws.uniform3(-reach, reach)), unit(draws.quaternion())});
  }
  return keys;
}

/// How fast the axes of the camera rotate and its center moves at t, from one side.
struct Speed {
  Vec3d center, x, y;
};
Speed speed_at(const CameraSpline& spline, double t, double step) {
  const CameraPose a = spline.at(t), b = spline.at(t + step);
  const Mat3<double> A = rotation_matrix(a.world_from_cam), B = rotation_matrix(b.world_from_cam);
  return {(b.position - a.position) / step, (B.row0 - A.row0) / step, (B.row1 - A.row1) / step};
}

TEST(CameraSpline, PassesItsKeysExactly) {
  for (const bool is_closed : {false, true})
    for (const std::uint64_t seed : {1, 2, 3, 4}) {
      const std::vector<CameraPose> keys = random_keys(7, seed);
      const CameraSpline spline(keys, is_closed);
      ASSERT_EQ(spline.knots().size(), is_closed ? 8u : 7u);
      for (std::size_t i = 0; i < spline.knots().size(); ++i) {
        const CameraPose pose = spline.at(spline.knots()[i]), &key = keys[i % keys.size()];
        EXPECT_LT(norm(pose.position - key.position), 1e-12) << i;
        EXPECT_LT(angle_between(pose.world_from_cam, key.world_from_cam), 1e-12) << i;
      }
    }
}

TEST(CameraSpline, RotationsHaveLengthOneEverywhere) {
  const CameraSpline spline(random_keys(9, 5), true);
  for (double t = -1; t < spline.end() + 1; t += 0.01)
    EXPECT_NEAR(squared_norm(spline.at(t).world_from_cam), 1, 1e-14);
}

// One-sided differences over h are wrong by h times half the curvature, which is below some 100
// here.
TEST(CameraSpline, PlaceAndAttitudeHaveOneSpeedOnBothSidesOfAKey) {
  for (const std::uint64_t seed : {1, 2, 3, 4}) {
    const CameraSpline spline(random_keys(7, seed), true);
    for (const double knot : spline.knots()) {
      constexpr double h = 1e-6;
      const Speed before = speed_at(spline, knot, -h), after = speed_at(spline, knot, h);
      EXPECT_LT(norm(before.center - after.center), 2e-4) << "at " << knot;
      EXPECT_LT(norm(before.x - after.x), 2e-4) << "at " << knot;
      EXPECT_LT(norm(before.y - after.y), 2e-4) << "at " << knot;
    }
  }
}

TEST(CameraSpline, ClosedCurveGoesOnWithTheNextRound) {
  const CameraSpline spline(random_keys(5, 6), true);
  for (double t = 0; t < spline.end(); t += 0.1) {
    const CameraPose here = spline.at(t), again = spline.at(t + spline.end());
    EXPECT_LT(norm(here.position - again.position), 1e-9);
    EXPECT_LT(angle_between(here.world_from_cam, again.world_from_cam), 1e-9);
  }
}

TEST(CameraSpline, TakesTheShortWayRoundWhateverSignsTheQuaternionsHave) {
  std::vector<CameraPose> keys, flipped;
  for (int i = 0; i < 5; ++i) {
    const double half = 0.2 * i;
    keys.push_back({{double(i), 0.0, 0.0}, {std::cos(half), 0, std::sin(half), 0}});
    flipped.push_back(keys.back());
    if (i % 2) flipped.back().world_from_cam = {-std::cos(half), 0, -std::sin(half), 0};
  }
  const CameraSpline a(keys, false), b(flipped, false);
  for (double t = 0; t <= a.end(); t += 0.05) {
    EXPECT_LT(angle_between(a.at(t).world_from_cam, b.at(t).world_from_cam), 1e-12);
    const double turned = 2 * std::asin(a.at(t).world_from_cam.y);
    EXPECT_GE(turned, -1e-9);
    EXPECT_LE(turned, 1.6 + 1e-9);
  }
}

TEST(CameraSpline, TwoKeysAreAStraightLine) {
  const CameraSpline spline({{{0.0, 0.0, 0.0}}, {{2.0, 4.0, -6.0}}}, false);
  const CameraPose middle = spline.at(spline.end() / 2);
  EXPECT_LT(norm(middle.position - Vec3d(1.0, 2.0, -3.0)), 1e-12);
}

TEST(CameraSpline, RepeatedKeysAndASingleOneAreNoTrouble) {
  const CameraPose a{{1.0, 2.0, 3.0}}, b{{2.0, 2.0, 3.0}};
  EXPECT_EQ(CameraSpline({a, a, b, b, a}, true).knots().size(), 3u);
  const CameraSpline single({a, a}, true);
  EXPECT_EQ(single.end(), 0);
  EXPECT_EQ(single.at(0.3).position, a.position);
  EXPECT_EQ(poses_along(single, 3, Pace::even).size(), 3u);
}

TEST(CameraSpline, TurningOnTheSpotTakesTime) {
  const CameraSpline spline({{{0.0, 0.0, 0.0}}, {{0.0, 0.0, 0.0}, {0.8, 0, 0.6, 0}}}, false);
  EXPECT_GT(spline.end(), 0.1);
  const double half = angle_between({1, 0, 0, 0}, {0.8, 0, 0.6, 0}) / 2;
  EXPECT_NEAR(angle_between({1, 0, 0, 0}, spline.at(spline.end() / 2).world_from_cam), half, 1e-9);
}

TEST(PosesAlong, BeginAndEndWithTheKeysOfAnOpenCurve) {
  const std::vector<CameraPose> keys = random_keys(6, 8);
  for (const Pace pace : {Pace::even, Pace::by_keys}) {
    const auto poses = poses_along(CameraSpline(keys, false), 31, pace);
    ASSERT_EQ(poses.size(), 31u);
    EXPECT_LT(norm(poses.front().position - keys.front().position), 1e-9);
    EXPECT_LT(norm(poses.back().position - keys.back().position), 1e-9);
    EXPECT_LT(angle_between(poses.back().world_from_cam, keys.back().world_from_cam), 1e-9);
  }
  const auto paced = poses_along(CameraSpline(keys, false), 31, Pace::by_keys);
  for (std::size_t i = 0; i < keys.size(); ++i)  // 30 steps over 5 intervals
    EXPECT_LT(norm(paced[6 * i].position - keys[i].position), 1e-9);
}

TEST(PosesAlong, AnEvenPaceIsEvenWhereverTheKeysAre) {
  std::vector<CameraPose> keys;
  for (const double x : {0.0, 0.1, 3.0, 3.2, 3.3, 9.0}) keys.push_back({{x, 0.0, 0.0}});
  const auto poses = poses_along(CameraSpline(keys, false), 91, Pace::even);
  for (std::size_t i = 0; i < poses.size(); ++i)
    EXPECT_NEAR(poses[i].position.x, 0.1 * double(i), 2e-3);  // chords of 1/128 of an interval
}

TEST(PosesAlong, AClosedCurveHasNoBreakAtItsEnd) {
  const CameraSpline spline(random_keys(6, 9), true);
  const auto poses = poses_along(spline, 2000, Pace::even);
  const auto step = [&](std::size_t i) {
    const CameraPose &a = poses[i % poses.size()], &b = poses[(i + 1) % poses.size()];
    return std::hypot(norm(a.position - b.position),
                      spline.turn_length() * angle_between(a.world_from_cam, b.world_from_cam));
  };
  // the last one leads back to the first
  for (std::size_t i = 0; i < poses.size(); ++i) EXPECT_NEAR(step(i) / step(0), 1, 0.05) << i;
}

TEST(CameraPose, IsThatOfTheCamera) {
  for (const std::uint64_t seed : {1, 2, 3}) {
    const Camera camera = random_camera(40, 30, seed);
    const Camera again = with_pose(camera, pose_of(camera));
    EXPECT_NEAR(norm(Vec3d(again.position() - camera.position())), 0, 1e-6);
    for (const auto row : {&Mat3<float>::row0, &Mat3<float>::row1, &Mat3<float>::row2}) {
      const Vec3d difference(again.cam_from_world_rotation.*row -
                             camera.cam_from_world_rotation.*row);
      EXPECT_LT(norm(difference), 1e-6);
    }
  }
}

TEST(CameraPose, AngleIsThatOfTheShortWay) {
  const double half = std::numbers::pi / 8;
  EXPECT_NEAR(angle_between({1, 0, 0, 0}, {-std::cos(half), std::sin(half), 0, 0}),
              std::numbers::pi / 4, 1e-12);
  EXPECT_NEAR(angle_between({1, 0, 0, 0}, {0, 0, 0, 1}), std::numbers::pi, 1e-12);
}

}  // namespace
}  // namespace gs
