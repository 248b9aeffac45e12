// SPDX-License-Identifier: Apache-2.0
// What cameras see of points: honest scenes are neither blind nor doubtful, and for others the reason
// and a remedy are named.
#include "gs_core/geometry/scene_sight.h"

#include "gs_core/math/random.h"
#include "tests/support/test.h"

namespace gs {
namespace {

/// Cameras around the y axis at a distance from the origin, which they look at.
std::vector<Camera> ring(float distance, int count = 12) {
  std::vector<Camera> cameras;
  for (int i = 0; i < count; ++i) {
    const float angle = 6.2831853f * float(i) / float(count);
    const float c = std::cos(angle), s = std::sin(angle);
    Camera camera;
    camera.width = 40;
    camera.height = 30;
    camera.fx = camera.fy = 40;
    camera.cx = 20;
    camera.cy = 15;
    camera.cam_from_world_rotation = {{c, 0, s}, {0, 1, 0}, {-s, 0, c}};
    camera.cam_from_world_translation = {0, 0, distance};
    cameras.push_back(camera);
  }
  return cameras;
}

/// The same cameras, each turned half around its y axis, as if poses had the wrong convention.
std::vector<Camera> turned_away(std::vector<Camera> cameras) {
  for (Camera& camera : cameras) {
    Mat3<float>& R = camera.cam_from_world_rotation;
    Vec3f& t = camera.cam_from_world_translation;
    R = {-R.row0, R.row1, -R.row2};
    t = {-t.x, t.y, -t.z};
  }
  return cameras;
}

std::vector<Vec3f> cube(float half_edge, int count = 500) {
  const Random random{3, RandomStream::test};
  std::vector<Vec3f> points;
  for (int i = 0; i < count; ++i) {
    const Vec4f u = random.uniform4(std::uint64_t(i));
    points.push_back(half_edge * (2.0f * Vec3f(u.x, u.y, u.z) - Vec3f(1.0f)));
  }
  return points;
}

SceneSight sight(const std::vector<Camera>& cameras, const std::vector<Vec3f>& points,
                 const DepthLimits& limits = {}) {
  return scene_sight(cameras, {points.data(), points.size()}, limits);
}

TEST(SceneSight, OfAnHonestSceneIsClear) {
  for (const float scale : {0.2f, 1.0f, 1000.0f}) {
    const SceneSight seen = sight(ring(3 * scale), cube(scale));
    EXPECT_EQ(seen.views_with_points_in_sight, 12u) << scale;
    EXPECT_FALSE(seen.is_blind() || seen.is_doubtful()) << scale;
  }
  EXPECT_FALSE(sight(ring(3), {}).is_blind());
  EXPECT_FALSE(sight({}, cube(1)).is_blind());
}

TEST(SceneSight, OnePointBetweenThePlanesIsNotBlind) {
  std::vector<Vec3f> points = cube(0.01f);
  const std::vector<Camera> cameras = ring(0.05f);
  ASSERT_TRUE(sight(cameras, points).is_blind());
  points.push_back({0, 0, 1});
  EXPECT_FALSE(sight(cameras, points).is_blind());
}

TEST(SceneSight, OfAFewPointsIsNeverDoubtful) {
  std::vector<Camera> cameras = ring(3);
  for (Camera& camera : cameras) camera.cam_from_world_translation.x += 100;
  EXPECT_TRUE(sight(cameras, cube(1)).is_doubtful());
  EXPECT_FALSE(sight(cameras, cube(1, 20)).is_doubtful());
}

TEST(SceneSight, IsDoubtfulIfMostViewsLookAside) {
  std::vector<Camera> cameras = ring(3);
  for (std::size_t i = 0; i < 6; ++i) cameras[i].cam_from_world_translation.x += 100;
  EXPECT_FALSE(sight(cameras, cube(1)).is_doubtful());  // half of them see something
  cameras[6].cam_from_world_translation.x += 100;
  const SceneSight seen = sight(cameras, cube(1));
  EXPECT_FALSE(seen.is_blind());
  EXPECT_TRUE(seen.is_doubtful());
  EXPECT_THAT(text_of(seen, {}), AllOf(HasSubstr("5 of 12 views see any of the 500 points"),
                                       HasSubstr("beside them; check the poses")));
}

TEST(SceneSight, NamesPosesThatLookAway) {
  const SceneSight seen = sight(turned_away(ring(3)), cube(1));
  EXPECT_TRUE(seen.is_blind());
  EXPECT_THAT(text_of(seen, {}), AllOf(HasSubstr("none of 12 views see any of the 500 points"),
                                       HasSubstr("behind them; check the poses")));
}

TEST(SceneSight, NamesAPlaneThatHidesEverythingAndOneThatDoesNot) {
  const std::vector<Camera> tiny = ring(0.05f), huge = ring(5e5f);
  const SceneSight near = sight(tiny, cube(0.01f)), far = sight(huge, cube(1e5f));
  EXPECT_TRUE(near.is_blind());
  EXPECT_THAT(text_of(near, {}), AllOf(HasSubstr("render.near_plane = 0.2, at about 0.05"),
                                       HasSubstr("--set render.near_plane=0.0005")));
  EXPECT_FALSE(sight(tiny, cube(0.01f), {0.0005f, 1e4f}).is_blind());
  EXPECT_TRUE(far.is_blind());
  EXPECT_THAT(text_of(far, {}), AllOf(HasSubstr("render.far_plane = 10000, at about 5e+05"),
                                      HasSubstr("--set render.far_plane=5e+07")));
  EXPECT_FALSE(sight(huge, cube(1e5f), {0.2f, 5e7f}).is_blind());
}

}  // namespace
}  // namespace gs
