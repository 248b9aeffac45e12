// SPDX-License-Identifier: Apache-2.0
#include "gs_train/initialize/initialize.h"

#include "gs_core/config/config_diff.h"
#include "gs_core/config/scene_settings.h"
#include "gs_core/math/render/projection.h"
#include "tests/support/models.h"

namespace gs {
namespace {

std::vector<ScenePoint> random_points(std::size_t count, std::uint64_t seed) {
  Draws draws(seed);
  std::vector<ScenePoint> points(count);
  for (ScenePoint& point : points) {
    point.position = draws.uniform3(-1, 1);
    for (std::uint8_t& channel : point.color) channel = std::uint8_t(draws.below(256));
  }
  return points;
}

Scene scene_with(std::vector<ScenePoint> points) {
  Scene scene;
  for (const std::uint64_t seed : {1, 2, 3})
    scene.train_views.push_back({"", random_camera(40, 30, seed), {}});
  scene.points = std::move(points);
  scene.extent = camera_extent(scene.train_views);
  return scene;
}

/// log of the root mean squared distance to the three nearest points, by brute force in double.
double log_scale_by_brute_force(const std::vector<ScenePoint>& points, std::size_t i) {
  std::vector<double> distances;
  for (std::size_t other = 0; other < points.size(); ++other) {
    const Vec3d offset = Vec3d(points[other].position) - Vec3d(points[i].position);
    if (other != i) distances.push_back(inner(offset, offset));
  }
  std::sort(distances.begin(), distances.end());
  return 0.5 * std::log((distances[0] + distances[1] + distances[2]) / 3);
}

TEST(InitialModel, HasOneGaussianForEachPointWhereItIs) {
  const Scene scene = scene_with(random_points(500, 1));
  const TrainingModel model = initial_model(scene, {}, host_memory());
  ASSERT_EQ(model.count(), 500u);
  for (std::size_t i = 0; i < 500; ++i)
    EXPECT_EQ(model.gaussians.mean[i], scene.points[i].position);
}

TEST(InitialModel, StartsWithNoMoreGaussiansThanTheCap) {
  Config config;
  config.density.max_gaussians = 300;
  for (const std::size_t points : {0u, 250u, 5'000u}) {  // 0: random ones
    const Scene scene = scene_with(random_points(points, 7));
    const std::size_t count = initial_model(scene, config, host_memory()).count();
    EXPECT_LE(count, 300u) << points;
    EXPECT_GE(count, 38u) << points;
    if (points == 250) {
      EXPECT_EQ(count, 250u);
    }
  }
  config.density.max_gaussians = 0;  // no cap
  EXPECT_EQ(initial_model(scene_with(random_points(900, 7)), config, host_memory()).count(), 900u);
}

TEST(InitialModel, ScalesAreTheDistanceToTheThreeNearestPoints) {
  const Scene scene = scene_with(random_points(500, 2));
  const TrainingModel model = initial_model(scene, {}, host_memory());
  for (std::size_t i = 0; i < 500; ++i)
    for (int axis = 0; axis < 3; ++axis)
      EXPECT_NEAR(model.gaussians.log_scale[i][axis], log_scale_by_brute_force(scene.points, i),
                  1e-5);
}

TEST(InitialModel, ScalesAreMultipliedByTheConfigsFactor) {
  const Scene scene = scene_with(random_points(50, 2));
  Config config;
  config.model.initial_scale = 0.1f;
  const TrainingModel plain = initial_model(scene, {}, host_memory()),
                      small = initial_model(scene, config, host_memory());
  for (std::size_t i = 0; i < 50; ++i)
    EXPECT_NEAR(small.gaussians.log_scale[i].y - plain.gaussians.log_scale[i].y, std::log(0.1f),
                1e-5);
}

TEST(InitialModel, LooksLikeItsPointsFromEverySide) {
  const Scene scene = scene_with(random_points(50, 3));
  const TrainingModel model = initial_model(scene, {}, host_memory());
  for (std::size_t i = 0; i < 50; ++i) {
    for (int c = 0; c < 3; ++c)
      EXPECT_NEAR(0.5 + 0.28209479177387814 * model.gaussians.sh0[i][c],
                  scene.points[i].color[c] / 255.0, 1e-6);
    EXPECT_TRUE(row_is(model.gaussians.sh_rest, i, 0.0f));
  }
}

TEST(InitialModel, IsUprightAndHasTheOpacityOfTheConfig) {
  Config config;
  config.model.initial_opacity = 0.3f;
  const TrainingModel model =
      initial_model(scene_with(random_points(10, 4)), config, host_memory());
  for (std::size_t i = 0; i < 10; ++i) {
    const Quatf& q = model.gaussians.rotation[i];
    EXPECT_TRUE(q.w == 1 && q.x == 0 && q.y == 0 && q.z == 0);
    EXPECT_NEAR(sigmoid(model.gaussians.logit_opacity[i]), 0.3f, 1e-6f);
  }
}

TEST(InitialModel, StartsWithZeroMomentsAndStatistics) {
  const TrainingModel model = initial_model(scene_with(random_points(10, 5)), {}, host_memory());
  EXPECT_TRUE(same_bits(model, model_of(model.gaussians, model.moment_storage())));
  EXPECT_EQ(model.statistics.visits.download(), std::vector<float>(10));
  EXPECT_EQ(model.statistics.gradient_norm.download(), std::vector<float>(10));
}

TEST(InitialModel, GivesDuplicatesAndALonePointTheSmallestScale) {
  for (const std::size_t count : {1, 6}) {
    const std::vector<ScenePoint> points(count, ScenePoint{{1, 2, 3}, {10, 20, 30}});
    const TrainingModel model = initial_model(scene_with(points), {}, host_memory());
    ASSERT_EQ(model.count(), count);
    for (std::size_t i = 0; i < count; ++i)
      EXPECT_NEAR(model.gaussians.log_scale[i].x, 0.5 * std::log(1e-7), 1e-5);
  }
}

TEST(InitialModel, AveragesOverFewerNeighborsWhereThereAreFewer) {
  const TrainingModel model =
      initial_model(scene_with({{{0, 0, 0}, {}}, {{0, 0, 2}, {}}}), {}, host_memory());
  EXPECT_NEAR(model.gaussians.log_scale[0].x, std::log(2.0), 1e-6);
}

TEST(InitialModel, WithoutPointsStartsFromRandomOnesThatACameraSees) {
  Config config;
  config.model.random_points = 3000;
  const Scene scene = scene_with({});
  const TrainingModel model = initial_model(scene, config, host_memory());
  EXPECT_GT(model.count(), 50u);
  EXPECT_LT(model.count(), 3000u);
  for (const Vec3f& mean : model.gaussians.mean) {
    const bool is_seen =
        std::any_of(scene.train_views.begin(), scene.train_views.end(), [&](const View& view) {
          const Vec3f p = to_camera(view.camera, mean);
          if (p.z < config.render.near_plane) return false;
          const Vec2f pixel = project_mean(view.camera, p);
          return pixel.x >= 0 && pixel.x < 40 && pixel.y >= 0 && pixel.y < 30;
        });
    EXPECT_TRUE(is_seen);
  }
}

TEST(InitialModel, WithoutPointsDependsOnTheSeedAlone) {
  Config config;
  config.model.random_points = 500;
  const Scene scene = scene_with({});
  const auto begun = [&] { return initial_model(scene, config, host_memory()); };
  const TrainingModel first = begun();
  EXPECT_TRUE(same_bits(with_threads(1, begun), first));
  config.train.seed = 43;
  EXPECT_FALSE(same_bits(begun(), first));
}

TEST(InitialModel, ThrowsWhereNoCameraSeesAnyRandomPoint) {
  Scene scene = scene_with({});
  for (View& view : scene.train_views) view.camera.cx = 1e9f;
  scene.source = "the/scene";
  EXPECT_THAT([&] { initial_model(scene, {}, host_memory()); },
              ThrowsMessage<Error>(HasSubstr("the/scene")));
  EXPECT_THAT([&] { initial_model(scene, {}, host_memory()); }, FailsWith(ExitCode::bad_data));
}

TEST(SceneSettings, BecomeNumbers) {
  const Scene scene = scene_with(random_points(500, 1));  // 3 photos
  Config config;
  config.train.epochs = 100;
  config.train.least_iterations = 200;
  config.density.gaussians_per_point = 1.5f;
  const Config settled = resolved_config(config, scene);
  EXPECT_EQ(settled.train.iterations, 300);
  EXPECT_EQ(settled.density.max_gaussians, 750);
  EXPECT_TRUE(config_diff(settled, resolved_config(settled, scene)).empty());
}

TEST(SceneSettings, StayWithinTheLimitsGiven) {
  const Scene scene = scene_with(random_points(500, 1));
  Config config;
  config.train.epochs = 100;
  config.train.least_iterations = 200;
  config.train.most_iterations = 250;
  EXPECT_EQ(resolved_config(config, scene).train.iterations, 250);
  config.train.most_iterations = 5000;
  config.train.least_iterations = 1000;
  EXPECT_EQ(resolved_config(config, scene).train.iterations, 1000);
  config.train.most_iterations = 400;
  EXPECT_EQ(resolved_config(config, scene).train.iterations, 400);
}

TEST(SceneSettings, DoNotReplaceNumbersThatAreGiven) {
  const Scene scene = scene_with(random_points(500, 1));
  Config config;
  config.train.iterations = 77;
  config.density.max_gaussians = 600;
  EXPECT_EQ(resolved_config(config, scene).train.iterations, 77);
  EXPECT_EQ(resolved_config(config, scene).density.max_gaussians, 600);
  config.density.max_gaussians = kAutoCount;
  EXPECT_EQ(resolved_config(config, scene).density.max_gaussians, kAutoCount);
}

TEST(SceneSettings, CountPointsOutsideOfTheRegionOnce) {
  const Scene scene = scene_with(random_points(500, 1));
  Config config;
  config.density.region = "1,0,0,0.1";
  std::int64_t inside = 0;
  for (const ScenePoint& point : scene.points) inside += double(point.position.x) >= 0.1;
  ASSERT_GT(inside, 100);
  ASSERT_LT(inside, 400);
  config.density.gaussians_per_point = 3;
  EXPECT_EQ(resolved_config(config, scene).density.max_gaussians, 3 * inside + 500 - inside);
}

TEST(SceneSettings, CountRandomPointsWhereTheSceneHasNone) {
  Config config;
  config.density.gaussians_per_point = 2;
  config.model.random_points = 100;
  EXPECT_EQ(resolved_config(config, scene_with({})).density.max_gaussians, 200);
}

TEST(SceneSettings, TakeMoreStepsFromARandomStart) {
  Config config;
  config.train.epochs = 100;
  config.train.least_iterations = 20;
  config.train.most_iterations = 600;
  config.train.random_start_factor = 2.5f;
  EXPECT_EQ(resolved_config(config, scene_with({})).train.iterations, 750);  // 3 photos
  config.train.most_iterations = 200;
  EXPECT_EQ(resolved_config(config, scene_with({})).train.iterations, 500);
  config.model.start_from = "model.ply";  // which is no random start
  EXPECT_EQ(resolved_config(config, scene_with({})).train.iterations, 200);
}

TEST(SceneSettings, GiveDenseCloudsNoMultipleOfTheirPoints) {
  Config config;
  config.density.gaussians_per_point = 25;
  EXPECT_EQ(resolved_config(config, {100'000, 50}).density.max_gaussians, 2'500'000);
  EXPECT_EQ(resolved_config(config, {1'000'000, 50}).density.max_gaussians, 10'000'000);
  EXPECT_EQ(resolved_config(config, {12'000'000, 50}).density.max_gaussians, 12'000'000);
}

// A blank wall has hardly any points.
TEST(SceneSettings, GiveASceneOfFewPointsGaussiansByThePixelsOfItsPhotos) {
  Config config;
  config.density.gaussians_per_point = 25;
  config.density.pixels_per_gaussian = 100;
  const auto limit = [&](const SceneNumbers& scene) {
    return resolved_config(config, scene).density.max_gaussians;
  };
  EXPECT_EQ(limit({1'000, 50, 5e7}), 500'000);
  EXPECT_EQ(limit({100'000, 50, 5e7}), 2'500'000);         // the points ask for more
  EXPECT_EQ(limit({1'000, 50, 5e7, 500}), 250'000 + 500);  // half of the points lie outside
  EXPECT_EQ(limit({0, 50, 5e7}), 25 * config.model.random_points);
  EXPECT_EQ(limit({1'000, 5'000, 5e10}), 10'000'000);
  config.density.pixels_per_gaussian = 0;
  EXPECT_EQ(limit({1'000, 50, 5e7}), 25'000);
}

TEST(SceneSettings, OfARunThatGoesOnAreItsNumbers) {
  Config run, now;
  run.train.iterations = 4300;
  run.density.max_gaussians = 700;
  now.train.epochs = 50;
  now.train.least_iterations = 1000;
  now.density.gaussians_per_point = 2;
  EXPECT_TRUE(config_diff(run, settled_as_in(run, now)).empty());
  now.train.iterations = 10000;
  now.density.max_gaussians = 800;
  EXPECT_EQ(settled_as_in(run, now).train.iterations, 10000);
  EXPECT_EQ(settled_as_in(run, now).density.max_gaussians, 800);
}

}  // namespace
}  // namespace gs
