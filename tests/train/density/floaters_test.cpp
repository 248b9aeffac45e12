// SPDX-License-Identifier: Apache-2.0
// What each Gaussian contributes to a view, and which ones float between cameras and what they see.
#include "gs_train/density/floaters.h"

#include "gs_train/density/contribution.h"
#include "gs_train/loop/trainer.h"
#include "tests/support/models.h"
#include "tests/support/small_scene.h"

namespace gs {
namespace {

/// All Gaussians together contribute what does not reach the background.
void expect_all_of_the_picture(const Gaussians& gaussians, const Camera& camera) {
  const auto renderer = make_scalar_renderer();
  RenderPass pass;
  renderer->forward(gaussians.span(), camera, {}, pass);
  double covered = 0;
  for (const float transmittance : pass.transmittance) covered += 1 - double(transmittance);
  ContributionMeter meter(*renderer, gaussians.span(), {});
  const std::vector<float>& shares = meter.measure(camera);
  const double sum = std::accumulate(shares.begin(), shares.end(), 0.0);
  EXPECT_GT(covered, 100);
  EXPECT_NEAR(sum / covered, 1, 1e-4);  // sums of floats over a thousand pixels
}

TEST(Contribution, OfAllGaussiansIsTheCoveredPicture) {
  const Camera camera = random_camera(64, 48);
  expect_all_of_the_picture(random_gaussians(kTypical, 200, camera, 1), camera);
  // Black ones contribute, too.
  expect_all_of_the_picture(random_gaussians(kNegativeColors, 200, camera, 2), camera);
  expect_all_of_the_picture(random_gaussians(kOpaque, 50, camera, 3), camera);
  expect_all_of_the_picture(in_spacetime(random_gaussians(kTypical, 200, camera, 1), 2), camera);
}

// One splat of variance s^2 = (64 * 0.1 / 2)^2 + 0.3 covers 2 pi s^2 o pixels, minus the part below
// 1/255.
TEST(Contribution, OfOneSplatIsItsArea) {
  Gaussians one(1, host_memory());
  set_gaussian(one, 0, {0, 0, 2}, 0.1f, 0.5f);
  Camera camera = plain_camera(64, 64);
  camera.cx = camera.cy = 32;
  const auto renderer = make_scalar_renderer();
  ContributionMeter meter(*renderer, one.span(), {});
  const double variance = 3.2 * 3.2 + 0.3, below = 1 / 255.0;
  EXPECT_NEAR(meter.measure(camera)[0], 2 * 3.14159265 * variance * (0.5 - below), 0.5);
}

TEST(Contribution, OfViewsOfOtherSizesFollowOneAnother) {
  const Camera large = orbit_camera(0), small = at_resolution(large, 2);
  const Gaussians truth = small_truth();
  const auto renderer = make_scalar_renderer();
  ContributionMeter meter(*renderer, truth.span(), {});
  const std::vector<float> first = meter.measure(large);
  const double halved = std::accumulate(first.begin(), first.end(), 0.0) / 4;
  const std::vector<float>& second = meter.measure(small);
  EXPECT_NEAR(std::accumulate(second.begin(), second.end(), 0.0) / halved, 1, 0.1);  // wider blur
  EXPECT_EQ(meter.measure(large), first);
}

class Floaters : public ::testing::Test {
 protected:
  static constexpr float kClearance = 0.5f;

  /// Points on a ball around the origin: each camera is at a distance of 3 and sees the near side
  /// at 2.
  static Scene scene_with_ball(std::size_t points = 5000) {
    Scene scene = small_scene();
    scene.points.clear();
    Draws draws(2);
    for (std::size_t i = 0; i < points; ++i) {
      const Vec3f way = draws.uniform3(-1, 1);
      scene.points.push_back({way * (1 / std::sqrt(inner(way, way))), {128, 128, 128}});
    }
    return scene;
  }
  /// A place in the middle of the first camera's picture.
  static Vec3f at_depth(float depth) { return {0, 0, -3 + depth}; }
  static bool is_floater(const Scene& scene, const Vec3f& place, int witnesses = 1) {
    return FloaterFinder(scene, kClearance, witnesses).marks({place})[0] == 1;
  }
  static Sight sight(const Scene& scene, std::size_t view, const Vec3f& place) {
    return PointDepths(scene.train_views[view].camera, scene.points).sight_of(place, kClearance);
  }
};

TEST_F(Floaters, AreSeenThroughWherePointsLieFarBehindThem) {
  const Scene scene = scene_with_ball();
  EXPECT_EQ(sight(scene, 0, at_depth(0.5f)), Sight::through);
  EXPECT_EQ(sight(scene, 0, at_depth(1.5f)), Sight::witness);
  EXPECT_EQ(sight(scene, 0, at_depth(2)), Sight::witness);
}

TEST_F(Floaters, AreNotKnownWhereAPhotoSaysNothing) {
  const Scene scene = scene_with_ball();
  EXPECT_EQ(sight(scene, 0, at_depth(6)), Sight::unknown);                   // behind the ball
  EXPECT_EQ(sight(scene, 0, at_depth(-1)), Sight::unknown);                  // behind the camera
  EXPECT_EQ(sight(scene, 0, {0.5f, 0, -2.5f}), Sight::unknown);              // out of the picture
  EXPECT_EQ(sight(scene_with_ball(20), 0, at_depth(0.5f)), Sight::unknown);  // too few points
}

TEST_F(Floaters, OneWrongPointInTenMakesNoDifference) {
  Scene scene = scene_with_ball();
  for (int i = 0; i < 3; ++i) scene.points.push_back({at_depth(0.1f), {}});
  EXPECT_EQ(sight(scene, 0, at_depth(0.5f)), Sight::through);
}

// The rule that was replaced measured against the nearest points of the whole picture, and removed
// walls that have none.
TEST_F(Floaters, AreNoneOnABlankWallBesideNearPoints) {
  Scene scene = scene_with_ball();
  // Only points in the lower half of the picture are left.
  std::erase_if(scene.points, [](const ScenePoint& point) { return point.position.y < 0.4f; });
  EXPECT_FALSE(is_floater(scene, {0, -0.15f, -2.5f}));
  EXPECT_TRUE(is_floater(scene, {0, 0.15f, -2.5f}));
}

TEST_F(Floaters, HangBeforeACameraAndNowhereElse) {
  const Scene scene = scene_with_ball();
  EXPECT_TRUE(is_floater(scene, at_depth(0.5f)));
  EXPECT_FALSE(is_floater(scene, at_depth(1.5f)));
  EXPECT_FALSE(is_floater(scene, at_depth(2)));
}

TEST_F(Floaters, AreNoneWhereAnotherPhotoShowsThemAmongItsPoints) {
  Scene scene = scene_with_ball();
  // A camera behind the first one, for which the place is at a depth of 2.5 of 4.
  View other = scene.train_views[0];
  other.camera.cam_from_world_translation.z = 5;
  scene.train_views.push_back(other);
  EXPECT_FALSE(is_floater(scene, at_depth(0.5f)));
  EXPECT_TRUE(is_floater(scene, at_depth(0.5f), 2));
}

TEST_F(Floaters, AreNotFoundWithoutPointsOrClearance) {
  EXPECT_FALSE(is_floater(scene_with_ball(0), at_depth(0.5f)));
  EXPECT_EQ(FloaterFinder(scene_with_ball(), 0).marks({at_depth(0.1f)})[0], 0);
  EXPECT_TRUE(FloaterFinder(scene_with_ball(), kClearance).marks({}).empty());
}

/// A run of 10 steps on a scene where one Gaussian starts in front of the first camera.
class FloatersOfARun : public Floaters {
 protected:
  FloatersOfARun() {
    scene_.points.push_back({at_depth(0.5f), {200, 200, 200}});
    config_.train.iterations = 10;
    config_.density.camera_clearance = kClearance;
  }
  const std::unique_ptr<Backend> backend_ = make_scalar_backend();
  Scene scene_ = scene_with_ball();
  Config config_ = adaptive_config();
};

TEST_F(FloatersOfARun, AreRemovedAndCounted) {
  Trainer trainer(scene_, config_, *backend_);
  trainer.run();
  EXPECT_EQ(trainer.gaussian_count(), 5000u);
  EXPECT_EQ(trainer.removed_floaters(), 1u);
}

TEST_F(FloatersOfARun, StayWithoutClearance) {
  config_.density.camera_clearance = 0;
  Trainer trainer(scene_, config_, *backend_);
  trainer.run();
  EXPECT_EQ(trainer.gaussian_count(), 5001u);
  EXPECT_EQ(trainer.removed_floaters(), 0u);
}

}  // namespace
}  // namespace gs
