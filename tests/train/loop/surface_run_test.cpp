// SPDX-License-Identifier: Apache-2.0
// Runs with surface terms: what they change, resuming, refusals, and which photos are neighbors.
#include "gs_eval/normal_angle.h"
#include "gs_train/features.h"
#include "gs_train/loop/neighbor_views.h"
#include "tests/support/error_of.h"
#include "tests/support/posed_scene.h"
#include "tests/support/scene_run.h"

namespace gs {
namespace {

class SurfaceRun : public SceneRun {
 protected:
  SurfaceRun() : SceneRun(posed_scene().given) {}  // of 15 photos around a ball
  static Config surface_run(int steps = 120) {
    Config config = growing_run(steps);
    config.surface.normal_weight = 0.05f;
    config.surface.photo_weight = 0.6f;
    config.surface.from_step = 5000;
    return config;
  }
  double angle_after(const Config& config) {
    Trainer trainer(scene_, config, *backend_);
    trainer.run();
    Evaluation evaluation;
    measure_normals(backend_->renderer(), trainer.model().gaussians, scene_.train_views,
                    trainer.evaluation_settings(), evaluation);
    return evaluation.normal_angle.value();
  }
};

TEST_F(SurfaceRun, IsAnyOtherRunBeforeItsFirstStep) {
  Config late = surface_run(60), without = growing_run(60);
  late.surface.from_step = 30500;
  EXPECT_TRUE(same_bits(trained(late), trained(without)));
  EXPECT_FALSE(same_bits(trained(surface_run(60)), trained(without)));
}

TEST_F(SurfaceRun, GoesOnWhereItWasStopped) {
  expect_goes_on_after({7, 60}, surface_run());
  Config batches = surface_run();
  batches.train.batch = 3;
  batches.train.resolution_ramp = {2};
  batches.train.resolution_every = 8000;  // 32 steps
  batches.train.resolution_least = 1;
  expect_goes_on_after({8, 31, 90}, batches);
}

TEST_F(SurfaceRun, HasTheSameBitsWithAnyNumberOfThreads) {
  expect_same_bits_on_any_threads(surface_run(50));
}

TEST_F(SurfaceRun, TurnsNormalsIntoTheSurface) {
  Config config = surface_run(300);
  config.surface.photo_weight = 0;
  config.surface.normal_weight = 0.2f;
  EXPECT_LT(angle_after(config), 0.8 * angle_after(growing_run(300)));
}

TEST_F(SurfaceRun, RefusesWhatItDoesNotTeach) {
  const auto refusal = [&](auto&& change, Features features = Features{{"l1_ssim"}, {"none"}}) {
    Config config = surface_run();
    change(config, features);
    return error_of([&] { check_supported(config, features, "the test"); });
  };
  using testing::HasSubstr;
  EXPECT_THAT(refusal([](Config& config, Features&) { config.model.dynamic = true; }),
              HasSubstr("train without model.dynamic"));
  EXPECT_THAT(refusal([](Config& config, Features&) { config.poses.refine = true; }),
              HasSubstr("train without poses.refine"));
  EXPECT_THAT(refusal([](Config& config, Features&) { config.render.order = RenderOrder::pixel; }),
              HasSubstr("render.order = \"z\""));
  EXPECT_THAT(refusal([](Config&, Features& features) { features.trains_surfaces = false; }),
              HasSubstr("--device cuda:0"));
  EXPECT_THAT(refusal([](Config& config, Features& features) {
                config.train.deterministic = true;
                features.repeats_surfaces = false;
              }),
              HasSubstr("train without train.deterministic"));
}

/// Cameras along a line that look at points in front of them, and one that looks away.
TEST(NeighborViews, SeeTheSamePointsFromBesideAndLookThereToo) {
  std::vector<View> views(6);
  std::vector<ScenePoint> points;
  for (std::size_t i = 0; i < views.size(); ++i) {
    views[i].camera = Camera{100, 80, 100, 100, 50, 40};
    views[i].camera.cam_from_world_translation = {-0.5f * float(i), 0, 0};
  }
  views[5].camera.cam_from_world_rotation = {{-1, 0, 0}, {0, 1, 0}, {0, 0, -1}};
  Draws draws(1);
  for (int k = 0; k < 900; ++k)
    points.push_back({{draws.uniform(-1, 2), draws.uniform(-1, 1), draws.uniform(3, 5)}, {}});
  const auto neighbors = neighbor_views(views, points);
  EXPECT_EQ(neighbors[2].size(), 4u);
  for (const std::uint32_t j : neighbors[2]) EXPECT_LT(j, 5u);
  EXPECT_THAT(std::vector<std::uint32_t>(neighbors[2].begin(), neighbors[2].begin() + 2),
              testing::UnorderedElementsAre(1u, 3u));
  EXPECT_TRUE(neighbors[5].empty());
  EXPECT_EQ(neighbor_views(views, {})[0].front(), 1u);
}

}  // namespace
}  // namespace gs
