// SPDX-License-Identifier: Apache-2.0
// Runs with surface terms: what they change, resuming, refusals, and which photos are neighbors.
#include "gs_core/geometry/vectors.h"
#include "gs_eval/normal_angle.h"
#include "gs_train/features.h"
#include "gs_train/loop/neighbor_views.h"
#include "gs_train/reduced_view.h"
#include "tests/support/corner_scene.h"
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

// ---- priors ------------------------------------------------------------------------------------

class PriorRun : public SceneRun {
 protected:
  PriorRun() : SceneRun(corner_scene(1, [](View& view, Draws&) { view.has_depth_map = false; })) {}
  static Config prior_run(float weight) {
    Config config = corner_run(1);
    config.surface.prior_weight = weight;
    config.surface.from_step = 1;
    return config;
  }
  /// The mean angle between the normals that held-out views show and the true ones.   degrees
  double angle_after(const Config& config) {
    Trainer trainer(scene_, config, *backend_);
    trainer.run();
    RenderSettings settings = trainer.evaluation_settings();
    settings.blends_surface = true;
    RenderPass pass;
    double sum = 0, count = 0;
    for (const View& view : scene_.test_views) {
      backend_->renderer().forward(trainer.model().gaussians.span(), view.camera, settings, pass);
      const NormalMap truth{view.normals.pixels.data(), view.camera.width};
      for (int y = 0; y < view.camera.height; ++y)
        for (int x = 0; x < view.camera.width; ++x) {
          const SurfaceRow& row = pass.surface_image[std::size_t(y * view.camera.width + x)];
          if (row.coverage < kLeastCoverage) continue;
          const double error = double(prior_error(row.of.normal, truth.at(x, y).normal()));
          sum += std::acos(std::clamp(1 - error, -1.0, 1.0)) * 180 / std::numbers::pi;
          ++count;
        }
    }
    EXPECT_GT(count, 0.9 * 2 * 48 * 36);
    return sum / count;
  }
};

TEST_F(PriorRun, BringsNormalsNearerToTheTruth) {
  const double without = angle_after(prior_run(0)), with = angle_after(prior_run(0.1f));
  EXPECT_LT(with, 0.5 * without);
}

TEST_F(PriorRun, IsAnyOtherRunWhereNoPhotoHasAMap) {
  Config with = prior_run(0.1f), without = prior_run(0);
  with.surface.normal_weight = without.surface.normal_weight = 0.05f;
  const TrainingModel expected = trained(without);
  for (View& view : scene_.train_views)
    view.normals = Image8(view.photo.width, view.photo.height, 3);
  EXPECT_TRUE(same_bits(trained(with), expected)) << "they know nothing";
  for (View& view : scene_.train_views) view.normals = {}, view.has_normal_map = false;
  EXPECT_THAT(error_of([&] { trained(with); }), testing::HasSubstr("dataset.normals=FOLDER"));
  scene_.train_views[0] = corner_scene(1, [](View&, Draws&) {}).train_views[0];
  EXPECT_FALSE(same_bits(trained(with), expected)) << "one of four has a map";
}

TEST_F(PriorRun, GoesOnWhereItWasStopped) {
  Config config = prior_run(0.1f);
  config.train.iterations = 90;
  expect_goes_on_after({40}, config);
  config.train.batch = 2;
  config.train.resolution_ramp = {2};
  config.train.resolution_every = 10000;  // 30 steps
  config.train.resolution_least = 1;
  expect_goes_on_after({21, 60}, config);
  expect_same_bits_on_any_threads(config);
}

TEST(NormalMap, OfAReducedPhotoHasTheMeansOfWhatIsKnown) {
  View view = view_of_corner(corner_camera(0, 0));
  const auto set = [&](int x, int y, const NormalBytes& n) {
    view.normals.at(x, y, 0) = n.x, view.normals.at(x, y, 1) = n.y, view.normals.at(x, y, 2) = n.z;
  };
  const NormalBytes up = bytes_of_normal({0, -1, 0}), facing = bytes_of_normal({0, 0, -1});
  for (const int x : {0, 1}) set(x, 0, up), set(x, 1, facing);
  set(2, 0, up), set(3, 0, up), set(2, 1, {}), set(3, 1, {});
  set(4, 0, up), set(5, 0, {}), set(4, 1, {}), set(5, 1, {});
  const View reduced = reduced_view(view, 2);
  const NormalMap map{reduced.normals.pixels.data(), reduced.camera.width};
  EXPECT_LT(length(map.at(0, 0).normal() - Vec3f(0, -0.5f, -0.5f)), 0.01f);
  EXPECT_LT(length(map.at(1, 0).normal() - Vec3f(0, -1, 0)), 0.01f);
  EXPECT_FALSE(map.at(2, 0).is_known());
  EXPECT_TRUE(reduced.has_normal_map);
  // As a device reads it, from the whole map.
  const NormalMap whole{view.normals.pixels.data(), view.camera.width, 2};
  for (int y = 0; y < reduced.camera.height; ++y)
    for (int x = 0; x < reduced.camera.width; ++x) EXPECT_EQ(whole.at(x, y).y, map.at(x, y).y);
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
