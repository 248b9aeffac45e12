// SPDX-License-Identifier: Apache-2.0
// The extent of a set of cameras, and the outliers that it leaves out.
#include "gs_core/scene.h"

#include "tests/support/test.h"

namespace gs {
namespace {

View view_at(const Vec3f& position) {
  View view;
  view.camera.cam_from_world_translation = -position;  // without rotation
  return view;
}

/// `count` cameras on a circle of radius 2 around (5, 0, 0).
std::vector<View> ring_of_views(int count) {
  std::vector<View> views;
  for (int i = 0; i < count; ++i) {
    const float angle = 6.2831853f * float(i) / float(count);
    views.push_back(view_at({5 + 2 * std::cos(angle), 0, 2 * std::sin(angle)}));
  }
  return views;
}

TEST(CameraExtent, IsElevenTenthsOfTheLargestDistanceFromTheMean) {
  EXPECT_NEAR(camera_extent(ring_of_views(40)), 2.2f, 1e-5f);
  EXPECT_NEAR(camera_extent({view_at({0, 0, 0}), view_at({2, 0, 0}), view_at({4, 0, 0})}), 2.2f,
              1e-5f);
}

TEST(CameraExtent, IsOneWithoutTwoPlaces) {
  EXPECT_EQ(camera_extent({}), 1.0f);
  EXPECT_EQ(camera_extent({view_at({3, 4, 5})}), 1.0f);
  EXPECT_EQ(camera_extent({view_at({3, 4, 5}), view_at({3, 4, 5})}), 1.0f);
}

TEST(CameraExtent, DoesNotGrowByAStrayCamera) {
  std::vector<View> views = ring_of_views(40);
  views.insert(views.begin() + 7, view_at({1e4f, -300, 70}));
  views.push_back(view_at({0, 900, 0}));
  EXPECT_THAT(outlier_cameras(views), ElementsAre(7, 41));
  EXPECT_NEAR(camera_extent(views), 2.2f, 1e-4f);
}

// The far end of a path, or a second group of cameras, is not an outlier.
TEST(StrayCameras, AreNotTheFarEndOfAPath) {
  std::vector<View> path, places = ring_of_views(30);
  for (int i = 0; i < 50; ++i) path.push_back(view_at({float(i * i), 0, 0}));
  for (int i = 0; i < 10; ++i) places.push_back(view_at({80, float(i), 0}));
  EXPECT_THAT(outlier_cameras(path), IsEmpty());
  EXPECT_THAT(outlier_cameras(places), IsEmpty());
}

TEST(StrayCameras, AreFoundAmongFive) {
  std::vector<View> views = ring_of_views(4);
  views.push_back(view_at({500, 0, 0}));
  EXPECT_THAT(outlier_cameras(views), ElementsAre(4));
}

TEST(StrayCameras, DoNotExistWhereAllStandAtOnePlace) {
  EXPECT_THAT(outlier_cameras(std::vector<View>(20, view_at({1, 2, 3}))), IsEmpty());
}

}  // namespace
}  // namespace gs
