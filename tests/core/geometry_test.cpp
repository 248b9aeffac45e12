// SPDX-License-Identifier: Apache-2.0
// Which way is up, what cameras look at, and the small geometry below that.
#include "gs_core/geometry/vectors.h"

#include "gs_core/geometry/scene_frame.h"
#include "gs_core/math/render/rotation.h"
#include "tests/support/arc_cameras.h"

namespace gs {
namespace {

TEST(Geometry, CrossIsAtRightAnglesByTheRightHandRule) {
  EXPECT_EQ(cross(Vec3d(1.0, 0.0, 0.0), Vec3d(0.0, 1.0, 0.0)), Vec3d(0.0, 0.0, 1.0));
  EXPECT_EQ(length(Vec3d(2.0, 3.0, 6.0)), 7);
  EXPECT_EQ(unit(Vec3f(0, -4, 0)), Vec3f(0, -1, 0));
}

TEST(Geometry, SolveFindsWhatTheMatrixWasMultipliedWith) {
  const Sym3<double> S{4, 1, -2, 5, 0.5, 3};
  const Vec3d x(0.3, -2.0, 1.5);
  EXPECT_LT(norm(solve(S, multiply(S, x)) - x), 1e-12);
}

TEST(RotationFault, NamesScalingShearingAndMirroring) {
  const Mat3<double> R = rotation_matrix(Quat<double>{0.3, -0.5, 0.1, 0.8});
  EXPECT_EQ(rotation_fault(R, 1e-9), RotationFault::none);
  EXPECT_TRUE(is_rotation(R, 1e-9));
  EXPECT_EQ(rotation_fault(Mat3<double>{R.row0, R.row1 * 1.1, R.row2}, 0.01),
            RotationFault::scales);
  EXPECT_EQ(rotation_fault(Mat3<double>{R.row0, unit(R.row1 + 0.1 * R.row0), R.row2}, 0.01),
            RotationFault::shears);
  EXPECT_EQ(rotation_fault(Mat3<double>{R.row0, R.row1, -R.row2}, 0.01), RotationFault::mirrors);
  EXPECT_EQ(rotation_fault(Mat3<double>{R.row0, R.row1, Vec3d(NAN)}, 0.01), RotationFault::scales);
}

TEST(SceneFrame, OfCamerasOnACircle) {
  const SceneFrame frame = scene_frame(arc(24, 1), {});
  EXPECT_LT(norm(frame.up - kUp), 1e-5);
  EXPECT_LT(norm(frame.center - Vec3d(5.0, 6.0, 7.0)), 1e-4);
  EXPECT_NEAR(frame.radius, 5, 1e-4);
  EXPECT_NEAR(frame.elevation, std::asin(0.6) * 180 / std::numbers::pi, 1e-3);
  EXPECT_NEAR(frame.up_spread, std::asin(0.6) * 180 / std::numbers::pi, 1e-3);  // all look down
}

// The mean of the pictures' columns leans back by some 33 degrees here.
TEST(SceneFrame, UpIsFoundFromAShortArcOfTiltedCameras) {
  const SceneFrame frame = scene_frame(arc(12, 0.25), {});
  EXPECT_LT(std::acos(inner(frame.up, kUp)) * 180 / std::numbers::pi, 3);
}

TEST(SceneFrame, ParallelAxesMeetWhereThePointsAre) {
  const std::vector<Vec3f> points{{0, 3, 0}, {4, 3, 0}, {9, 3, 1}, {NAN, 0, 0}};
  std::vector<Camera> cameras;
  for (int i = 0; i < 10; ++i)
    cameras.push_back(looking({double(i), 0.0, 0.0}, {double(i), 100.0, 0.0}));
  const SceneFrame frame = scene_frame(cameras, {points.data(), points.size()});
  EXPECT_LT(norm(frame.center - Vec3d(4.5, 3.0, 0.0)), 0.01);
  EXPECT_LT(norm(frame.up - kUp), 1e-3);
}

TEST(SceneFrame, OneOutlierCameraChangesNothing) {
  std::vector<Camera> cameras = arc(24, 1);
  const SceneFrame expected = scene_frame(cameras, {});
  cameras.push_back(looking({1000.0, 0.0, 0.0}, {2000.0, 0.0, 0.0}));
  EXPECT_LT(norm(scene_frame(cameras, {}).center - expected.center), 1e-9);
}

TEST(SceneFrame, AboutAGivenCenterIsMeasuredFromThere) {
  const SceneFrame frame = scene_frame_about({5.0, 6.0, 10.0}, arc(24, 1));
  EXPECT_NEAR(frame.radius, 4, 1e-5);
  EXPECT_NEAR(frame.elevation, 0, 1e-4);
}

TEST(SceneFrame, WithoutCamerasIsThatOfThePoints) {
  const std::vector<Vec3f> points{{0, 0, 0}, {1, 0, 0}, {2, 0, 0}, {3, 0, 0}, {4, 0, 0}};
  const SceneFrame frame = scene_frame({}, {points.data(), points.size()});
  EXPECT_EQ(frame.center, Vec3d(2.0, 0.0, 0.0));
  EXPECT_EQ(frame.radius, 2);
  EXPECT_EQ(frame.up, Vec3d(0.0, -1.0, 0.0));
  EXPECT_GT(scene_frame({}, {}).radius, 0);
}

TEST(SceneFrame, UpSpreadIsLargeForCamerasHeldInAllDirections) {
  std::vector<Camera> cameras;
  for (int i = 0; i < 8; ++i) {
    CameraPose pose;  // looks along z and is turned about it
    const double half = std::numbers::pi / 8 * i;
    pose.world_from_cam = {std::cos(half), 0, 0, std::sin(half)};
    cameras.push_back(with_pose(Camera(), pose));
  }
  EXPECT_GT(scene_frame(cameras, {}).up_spread, 60);
}

TEST(SceneFrame, UpIsKnownOfLevelCamerasAndOfADroneButNotOfPhotosOnTheirSide) {
  EXPECT_TRUE(scene_frame(arc(24, 1), {}).up_is_known);
  const Vec3d center(5.0, 6.0, 7.0);
  std::vector<Camera> drone, on_their_side;
  for (int i = 0; i < 24; ++i) {  // looks down by 72 degrees
    const double angle = 2 * std::numbers::pi * i / 24;
    drone.push_back(
        looking(center + Vec3d(4 * std::cos(angle), 4 * std::sin(angle), 12.0), center));
  }
  EXPECT_GT(scene_frame(drone, {}).up_spread, 60);
  EXPECT_LT(norm(scene_frame(drone, {}).up - kUp), 0.05);
  EXPECT_TRUE(scene_frame(drone, {}).up_is_known);
  for (Camera camera : arc(24, 1)) {
    const Vec3f position = camera.position();
    Mat3<float>& R = camera.cam_from_world_rotation;
    R = {-R.row1, R.row0, R.row2};
    camera.cam_from_world_translation = -multiply(R, position);
    on_their_side.push_back(camera);
  }
  EXPECT_FALSE(scene_frame(on_their_side, {}).up_is_known);
  EXPECT_FALSE(scene_frame({}, {}).up_is_known);
}

}  // namespace
}  // namespace gs
