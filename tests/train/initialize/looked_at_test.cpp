// SPDX-License-Identifier: Apache-2.0
#include "gs_train/initialize/looked_at.h"

#include "gs_train/initialize/initialize.h"
#include "tests/support/scenes.h"

namespace gs {
namespace {

constexpr float kDistance = 4;
const Vec3f kTarget(10, -2, 3);

// A camera at `position` whose optical axis goes through `target`. Pictures of 80 x 40 pixels.
View looking(const Vec3f& position, const Vec3f& target) {
  View view;
  view.camera = {.width = 80, .height = 40, .fx = 80, .fy = 80, .cx = 40, .cy = 20};
  const Vec3f z = (target - position) / std::sqrt(inner(target - position, target - position));
  const Vec3f right = cross(Vec3f(0, 0, 1), z);
  const Vec3f x = right / std::sqrt(inner(right, right)), y = cross(z, x);
  view.camera.cam_from_world_rotation = {x, y, z};
  view.camera.cam_from_world_translation = -multiply(view.camera.cam_from_world_rotation, position);
  return view;
}

// Twelve cameras on a circle around the target. `sign` -1: they look away from it.
std::vector<View> ring(float sign) {
  std::vector<View> views;
  for (int i = 0; i < 12; ++i) {
    const float angle = 0.5236f * float(i);
    const Vec3f position =
        kTarget + kDistance * Vec3f(0.8f * std::cos(angle), 0.8f * std::sin(angle), 0.6f);
    views.push_back(looking(position, position + sign * (kTarget - position)));
  }
  return views;
}

TEST(LookedAt, IsWhereTheAxesMeetAndAsLargeAsThePictures) {
  const auto found = looked_at(ring(1));
  ASSERT_TRUE(found.has_value());
  for (int c = 0; c < 3; ++c) EXPECT_NEAR(found->center[c], kTarget[c], 1e-4);
  EXPECT_NEAR(found->radius, kDistance * 40 / 80 / 2, 1e-4);
}

TEST(LookedAt, LeavesOutFewCamerasThatLookElsewhere) {
  std::vector<View> views = ring(1);
  for (int i = 0; i < 12; ++i) views.push_back(views[i]);
  views.push_back(looking(kTarget + Vec3f(kDistance, 0, 0), kTarget + Vec3f(kDistance, 5, 0)));
  const auto found = looked_at(views);
  ASSERT_TRUE(found.has_value());
  EXPECT_NEAR(found->radius, kDistance / 4, 0.05);
  for (int i = 0; i < 5; ++i) views.push_back(views.back());
  EXPECT_FALSE(looked_at(views).has_value());
}

TEST(LookedAt, IsNothingForCamerasThatLookOutward) { EXPECT_FALSE(looked_at(ring(-1))); }

TEST(LookedAt, IsNothingForParallelAxes) {
  std::vector<View> views;
  for (int i = 0; i < 5; ++i) views.push_back(looking({float(i), 0, 0}, {float(i), 100, 0}));
  EXPECT_FALSE(looked_at(views));
  EXPECT_FALSE(looked_at({views[0]}));
}

TEST(InitialModel, DrawsRandomPointsWhereCamerasLook) {
  Scene scene;
  scene.train_views = ring(1);
  scene.extent = camera_extent(scene.train_views);
  const TrainingModel model = initial_model(scene, {}, host_memory());
  EXPECT_GT(model.count(), 7'500u);  // of 15,000
  for (const Vec3f& mean : model.gaussians.mean)
    for (int c = 0; c < 3; ++c) EXPECT_NEAR(mean[c], kTarget[c], 1.001f);
}

}  // namespace
}  // namespace gs
