// SPDX-License-Identifier: Apache-2.0
// What each Gaussian contributes to a view, and which ones float in front of cameras.
#include "gs_train/density/floaters.h"

#include <gtest/gtest.h>

#include <numeric>

#include "gs_core/math/activations.h"
#include "gs_train/density/contribution.h"
#include "gs_train/loop/trainer.h"
#include "tests/support/adaptive.h"
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
  // The slopes of colors are no part of it.
  expect_all_of_the_picture(
      with_slopes(in_spacetime(random_gaussians(kTypical, 200, camera, 1), 2), 3), camera);
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
  /// Points on a ball around the origin: each camera is at a distance of 3 and sees the near side
  /// at 2.
  Scene scene_with_ball(std::size_t points) {
    Scene scene = small_scene();
    scene.points.clear();
    Draws draws(2);
    for (std::size_t i = 0; i < points; ++i) {
      const Vec3f way = draws.uniform3(-1, 1);
      scene.points.push_back({way * (1 / std::sqrt(inner(way, way))), {128, 128, 128}});
    }
    return scene;
  }
  /// The small scene's Gaussians, and one in front of the first camera, at (0, 0, -3).
  static Gaussians with_one_at_depth(float depth, float opacity = 0.9f) {
    Gaussians one(1, host_memory());
    set_gaussian(one, 0, {0, 0, -3 + depth}, 0.05f, opacity);
    return joined(small_truth(), one);
  }
  static std::vector<std::uint8_t> found(const Scene& scene, const Gaussians& gaussians,
                                         float clearance, int witnesses = 0) {
    const auto renderer = make_scalar_renderer();
    return find_floaters(*renderer, gaussians.span(), gaussians.mean.download(), scene, {},
                         clearance, witnesses);
  }
  static std::size_t count(const std::vector<std::uint8_t>& marks) {
    return std::size_t(std::count(marks.begin(), marks.end(), 1));
  }
};

TEST_F(Floaters, ClearanceIsAShareOfTheWayToTheNearestThing) {
  for (const float distance :
       clear_distances(scene_with_ball(5000).train_views, scene_with_ball(5000).points, 0.5f))
    EXPECT_NEAR(distance, 1, 0.1);
}

TEST_F(Floaters, OneWrongPointInAHundredMakesNoDifference) {
  Scene scene = scene_with_ball(5000);
  // in front of the first camera
  for (int i = 0; i < 20; ++i) scene.points.push_back({{0, 0, -2.9f}, {}});
  EXPECT_NEAR(clear_distances(scene.train_views, scene.points, 0.5f)[0], 1, 0.1);
}

TEST_F(Floaters, WherePointsAreFewNothingIsKnown) {
  for (const float distance :
       clear_distances(scene_with_ball(20).train_views, scene_with_ball(20).points, 0.5f))
    EXPECT_EQ(distance, 0);
  EXPECT_EQ(count(found(scene_with_ball(20), with_one_at_depth(0.5f), 0.5f)), 0u);
}

TEST_F(Floaters, WhatHangsBeforeACameraIsFoundAndNothingElse) {
  const std::vector<std::uint8_t> marks =
      found(scene_with_ball(5000), with_one_at_depth(0.5f), 0.5f);
  EXPECT_EQ(count(marks), 1u);
  EXPECT_EQ(marks.back(), 1);
  EXPECT_EQ(count(found(scene_with_ball(5000), with_one_at_depth(1.5f), 0.5f)), 0u);
}

TEST_F(Floaters, WhatOthersSeeFromFartherAwayIsNone) {
  const Scene scene = scene_with_ball(5000);
  const Gaussians gaussians = with_one_at_depth(0.5f);
  const auto renderer = make_scalar_renderer();
  ContributionMeter meter(*renderer, gaussians.span(), {});
  int witnesses = 0;
  for (std::size_t v = 1; v < scene.train_views.size(); ++v)
    witnesses += meter.measure(scene.train_views[v].camera).back() >= 1;
  ASSERT_GE(witnesses, 1);
  EXPECT_EQ(count(found(scene, gaussians, 0.5f, witnesses)), 0u);
  EXPECT_EQ(count(found(scene, gaussians, 0.5f, witnesses + 1)), 1u);
}

TEST_F(Floaters, NothingIsFoundInAnEmptyModelOrScene) {
  EXPECT_TRUE(found(scene_with_ball(5000), Gaussians(0, host_memory()), 0.5f, 3).empty());
  EXPECT_EQ(count(found(scene_with_ball(0), with_one_at_depth(0.1f), 0.5f, 3)), 0u);
}

TEST_F(Floaters, AreHiddenAndComeBackBitForBit) {
  const Scene scene = scene_with_ball(5000);
  TrainingModel model = model_of(with_one_at_depth(0.5f));
  const TrainingModel before = copy_to(host_memory(), model);
  {
    const HiddenFloaters hidden(model, ClearSpace(scene, 0.5f));
    EXPECT_LT(sigmoid(model.gaussians.logit_opacity[40]), kMinAlpha);
    EXPECT_EQ(model.gaussians.logit_opacity[39], before.gaussians.logit_opacity[39]);
  }
  EXPECT_TRUE(same_bits(model, before));
  {
    const HiddenFloaters none(model, ClearSpace(scene, 0));
    EXPECT_TRUE(same_bits(model, before));
  }
  HiddenFloaters(model, ClearSpace(scene, 0.5f)).leave();
  EXPECT_LT(sigmoid(model.gaussians.logit_opacity[40]), kMinAlpha);
}

TEST_F(Floaters, AFailureWhileTheyAreHiddenGivesThemBack) {
  Scene scene = scene_with_ball(5000);
  scene.points.push_back({{0, 0, -2.5f}, {200, 200, 200}});
  Config config = adaptive_config();
  config.density.camera_clearance = 0.5f;
  const auto backend = make_scalar_backend();
  Trainer trainer(scene, config, *backend);
  const std::vector<float> before = trainer.model().gaussians.logit_opacity.download();
  EXPECT_THROW(trainer.look_at_result([&](const Gaussians& gaussians) {
    EXPECT_NE(gaussians.logit_opacity.download(), before);
    throw Error("out of memory, says the test", ExitCode::out_of_memory);
  }),
               Error);
  EXPECT_EQ(trainer.model().gaussians.logit_opacity.download(), before);
}

/// Looks at the result after the third step.
class Look : public Observer {
 public:
  void after_step(int step, Trainer& trainer) override {
    if (step != 3) return;
    trainer.look_at_result(
        [&](const Gaussians& gaussians) { seen = gaussians.logit_opacity.download(); });
    after = trainer.model().gaussians.logit_opacity.download();
  }
  std::vector<float> seen, after;
};

TEST_F(Floaters, AreNoPartOfWhatTrainingLeavesNorOfWhatObserversSee) {
  Scene scene = scene_with_ball(5000);
  // a Gaussian starts here, in front of the first camera
  scene.points.push_back({{0, 0, -2.5f}, {200, 200, 200}});
  Config config = adaptive_config();
  config.train.iterations = 5;
  config.density.camera_clearance = 0.5f;
  const auto backend = make_scalar_backend();
  Look look;
  Trainer cleaned(scene, config, *backend);
  cleaned.add_observer(look);
  cleaned.run();
  EXPECT_EQ(cleaned.gaussian_count(), 5000u);
  const auto hidden = [](float logit) { return sigmoid(logit) < kMinAlpha; };
  EXPECT_EQ(std::count_if(look.seen.begin(), look.seen.end(), hidden), 1);
  EXPECT_EQ(std::count_if(look.after.begin(), look.after.end(), hidden), 0);
  config.density.camera_clearance = 0;
  Trainer as_it_was(scene, config, *backend);
  as_it_was.run();
  EXPECT_EQ(as_it_was.gaussian_count(), 5001u);
}

// Neither paper removes Gaussians in front of cameras.
TEST_F(Floaters, StayUnderThePresetsOfPapers) {
  Scene scene = scene_with_ball(5000);
  scene.points.push_back({{0, 0, -2.5f}, {200, 200, 200}});  // as in the test before
  const auto backend = make_scalar_backend();
  for (const char* preset : {"paper_3dgs", "paper_faster_gs"}) {
    Config config = adaptive_config();
    load_config(config, preset);
    EXPECT_TRUE(ClearSpace(scene, config.density.camera_clearance).marks({{0, 0, -2.5f}}).empty());
    config.train.iterations = 3;
    Trainer trainer(scene, config, *backend);
    trainer.run();
    EXPECT_EQ(trainer.gaussian_count(), 5001u) << preset;
  }
}

}  // namespace
}  // namespace gs
