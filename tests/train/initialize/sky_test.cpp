// SPDX-License-Identifier: Apache-2.0
// model.sky, on a plain of checkered ground under an even sky that eight cameras look at from its
// middle.
#include "gs_train/initialize/sky.h"

#include <gtest/gtest.h>

#include <cmath>

#include "gs_core/math/projection.h"
#include "gs_core/math/splat.h"
#include "gs_train/density/density_control.h"
#include "gs_train/initialize/initialize.h"
#include "tests/support/adaptive.h"
#include "tests/support/models.h"

namespace gs {
namespace {

constexpr float kHorizon = 0.1f;  // sine of the elevation up to which there are points
const Vec3f kBlue{60, 120, 200};

/// A camera one unit from the origin that looks away from it, `turn` radians around the vertical
/// axis y, which points down.
Camera outward_camera(float turn) {
  Camera camera;
  camera.width = 96;
  camera.height = 96;
  camera.fx = camera.fy = 48;
  camera.cx = camera.cy = 48;
  const float c = std::cos(turn), s = std::sin(turn);
  camera.cam_from_world_rotation = {{c, 0, -s}, {0, 1, 0}, {s, 0, c}};
  camera.cam_from_world_translation = {0, 0, -1};
  return camera;
}

/// The sine of the elevation of a direction.
float elevation(const Vec3f& direction) {
  return -direction.y / std::sqrt(inner(direction, direction));
}

/// What the camera sees through a pixel: the sky's color, or dark and bright ground by turns.
Vec3f color_through(const Camera& camera, int x, int y, const Vec3f& sky) {
  const Vec3f ray{(float(x) + 0.5f - camera.cx) / camera.fx,
                  (float(y) + 0.5f - camera.cy) / camera.fy, 1};
  const Vec3f direction = multiply_transposed(camera.cam_from_world_rotation, ray);
  if (elevation(direction) > kHorizon) return sky;
  return Vec3f((x + y) % 2 == 0 ? 30.0f : 220.0f);
}

Image8 photo_of(const Camera& camera, const Vec3f& sky, const Vec3f& exposure) {
  Image8 photo(camera.width, camera.height, 3);
  for (int y = 0; y < camera.height; ++y)
    for (int x = 0; x < camera.width; ++x)
      for (int c = 0; c < 3; ++c)
        photo.at(x, y, c) = std::uint8_t(exposure[c] * color_through(camera, x, y, sky)[c] + 0.5f);
  return photo;
}

/// `sky(k)` is the sky's color in photo k, `exposure(k)` the photo's exposure.
template <class Sky, class Exposure>
Scene plain(Sky&& sky, Exposure&& exposure) {
  Scene scene;
  for (int k = 0; k < 8; ++k) {
    View view;
    view.camera = outward_camera(0.785f * float(k));
    view.exposure = exposure(k);
    view.photo = photo_of(view.camera, sky(k), view.exposure);
    scene.train_views.push_back(view);
  }
  Draws draws(3);
  for (int i = 0; i < 4000; ++i) {
    Vec3f point = 6.0f * draws.uniform3(-1, 1);
    point.y = 6 * draws.uniform(-kHorizon, 0.7f);
    scene.points.push_back({point, {128, 128, 128}});
  }
  scene.extent = camera_extent(scene.train_views);
  return scene;
}
Scene even_plain() {
  return plain([](int) { return kBlue; }, [](int) { return Vec3f(1.0f); });
}

Config with_sky() {
  Config config = adaptive_config();
  config.model.sky = SkyModel::sphere;
  return config;
}

TEST(Sky, IsWherePhotosShowWhatNoPointExplains) {
  const Sky sky = sky_of(even_plain(), with_sky());
  // The cameras see up to 45 degrees above the horizon, each direction in one photo and its
  // neighbors; a band of that height is .35 of the sphere.
  EXPECT_GT(sky.points.size(), 2000u);
  EXPECT_LT(sky.points.size(), 7000u);
  for (const ScenePoint& point : sky.points) {
    EXPECT_GT(elevation(point.position), kHorizon);
    for (std::size_t c = 0; c < 3; ++c) EXPECT_NEAR(point.color[c], kBlue[int(c)], 1);
  }
}

TEST(Sky, LiesBeyondAllPoints) {
  const Scene scene = even_plain();
  const Sky sky = sky_of(scene, with_sky());
  ASSERT_FALSE(sky.points.empty());
  for (const ScenePoint& point : sky.points)
    EXPECT_GE(std::sqrt(inner(point.position, point.position)), 29.9f * scene.extent);
}

TEST(Sky, IsNotWherePhotosDisagree) {
  const Scene scene = plain([](int k) { return Vec3f(k % 2 == 0 ? 40.0f : 200.0f); },
                            [](int) { return Vec3f(1.0f); });
  EXPECT_LT(sky_of(scene, with_sky()).points.size(),
            sky_of(even_plain(), with_sky()).points.size() / 4);
}

TEST(Sky, HasTheScenesColorsWherePhotosHaveExposures) {
  const Scene scene =
      plain([](int) { return kBlue; }, [](int k) { return Vec3f(k % 2 == 0 ? 0.5f : 1.0f); });
  const Sky sky = sky_of(scene, with_sky());
  EXPECT_GT(sky.points.size(), 2000u);
  for (const ScenePoint& point : sky.points)
    for (std::size_t c = 0; c < 3; ++c) EXPECT_NEAR(point.color[c], kBlue[int(c)], 2);
}

TEST(Sky, IsNotUnderMasks) {
  Scene scene = even_plain();
  for (View& view : scene.train_views) view.mask = Image8(view.camera.width, view.camera.height, 1);
  EXPECT_TRUE(sky_of(scene, with_sky()).points.empty());
}

TEST(Sky, NeedsTheSettingAndSparsePoints) {
  EXPECT_TRUE(sky_of(even_plain(), {}).points.empty());
  Scene scene = even_plain();
  scene.points.clear();
  EXPECT_TRUE(sky_of(scene, with_sky()).points.empty());
}

TEST(Sky, LeavesHalfOfTheCapToTheScene) {
  Config config = with_sky();
  config.density.max_gaussians = 3000;
  EXPECT_THROW(sky_of(even_plain(), config), UsageError);
  config.density.max_gaussians = 20000;
  const Scene scene = even_plain();
  const std::size_t sky = sky_of(scene, config).points.size();
  EXPECT_EQ(initial_model(scene, config, host_memory()).count(), 4000 + sky);
  config.density.max_gaussians = std::int64_t(2 * sky);
  EXPECT_LE(initial_model(scene, config, host_memory()).count(), 2 * sky);
}

TEST(Sky, StartsAsOpaqueGaussiansThatTouchEachOther) {
  const Scene scene = even_plain();
  const Sky sky = sky_of(scene, with_sky());
  const TrainingModel model = initial_model(scene, with_sky(), host_memory());
  const std::size_t last = model.count() - 1;
  EXPECT_EQ(model.gaussians.mean[last], sky.points.back().position);
  EXPECT_NEAR(sigmoid(model.gaussians.logit_opacity[last]), 0.9f, 1e-6f);
  EXPECT_GT(std::exp(model.gaussians.log_scale[last].x), 0.5f * sky.spacing);
}

/// Refines the initial model at a step that prunes large Gaussians; those of the sky stay.
void keeps_the_sky(const std::string& strategy) {
  const Scene scene = even_plain();
  Config config = with_sky();
  config.density.strategy = strategy;
  config.model.initial_scale = 0.1f;  // of the points, which are smaller than the limit then
  TrainingModel model = initial_model(scene, config, host_memory());
  const auto backend = make_scalar_backend();
  const Schedule schedule(config, scene.extent);
  ASSERT_TRUE(schedule.prune_large(3100));
  const std::size_t before = model.count();
  make_density_control(config, schedule, scene.extent)->after_step(model, *backend, 3100);
  EXPECT_EQ(model.count(), before);

  config.model.sky = SkyModel::none;  // without the setting the same Gaussians are too large
  make_density_control(config, schedule, scene.extent)->after_step(model, *backend, 3100);
  EXPECT_EQ(model.count(), 4000u);
}
TEST(Sky, IsNotPrunedForItsSizeByAdaptive) { keeps_the_sky("adaptive"); }
TEST(Sky, IsNotPrunedForItsSizeBySpeedySplat) { keeps_the_sky("speedy_splat"); }

}  // namespace
}  // namespace gs
