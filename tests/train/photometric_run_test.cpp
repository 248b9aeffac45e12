// SPDX-License-Identifier: Apache-2.0
// Runs with a photometric model on a rendered scene whose photos are multiplied by known gains.
#include <gmock/gmock.h>

#include <cmath>

#include "gs_core/threads/parallel.h"
#include "gs_train/photometric/photometric_start.h"
#include "tests/support/scene_run.h"
#include "tests/support/small_scene.h"

namespace gs {
namespace {

constexpr std::size_t kViews = 12, kCameras = 3;

/// Photo k shows exp(a - B) times the scene, with gains up to a stop apart. The mean of each
/// channel's logs is 0.
Vec3f true_log_gain(std::size_t k) {
  const float turn = 6.2831853f * float(k) / float(kViews);
  return {0.35f * std::sin(turn), 0.3f * std::sin(2 * turn + 1), 0.3f * std::cos(turn)};
}

/// cos^4 of the angle from the axis, for three lenses of which the widest sees 40 degrees.
float true_log_vignetting(std::size_t camera, float rho) {
  const float tan2 = (camera == 0 ? 0.0f : camera == 1 ? 0.3f : 0.7f) * rho;
  return 2 * std::log1p(tan2);
}

/// Gaussians that fill the pictures to their corners, and are dark enough to be multiplied.
Gaussians wide_truth(std::vector<ScenePoint>& points) {
  Draws draws(5);
  Gaussians truth(260, host_memory());
  for (std::size_t i = 0; i < truth.count(); ++i) {
    const Vec3f place = draws.uniform3(-1.8f, 1.8f), color = draws.uniform3(0.05f, 0.5f);
    set_gaussian(truth, i, place, draws.uniform(0.2f, 0.4f), 0.9f, color);
    const auto byte = [](float value) { return std::uint8_t(255 * value); };
    points.push_back({place, {byte(color.x), byte(color.y), byte(color.z)}});
  }
  return truth;
}

Scene varied_scene(bool is_varied, bool is_vignetted) {
  Scene scene;
  scene.source = "a scene of the test";
  const Gaussians truth = wide_truth(scene.points);
  const auto renderer = make_scalar_renderer();
  RenderPass pass;
  for (std::size_t k = 0; k < kViews; ++k) {
    Camera camera = orbit_camera(6.2831853f * float(k) / float(kViews));
    camera.cam_from_world_translation.z = 4.5f;
    renderer->forward(truth.span(), camera, {}, pass);
    const Vec3f a = is_varied ? true_log_gain(k) : Vec3f(0);
    const LensPlace place = lens_place(camera.cx, camera.cy, camera.width, camera.height, 1);
    Image8 photo(camera.width, camera.height, 3);
    for (std::size_t i = 0; i < pass.pixel_count(); ++i) {
      const float x = float(i % 48) + 0.5f, y = float(i / 48) + 0.5f;
      const float B = is_vignetted ? true_log_vignetting(k % kCameras, place.rho(x, y)) : 0.0f;
      for (int c = 0; c < 3; ++c) {
        const float value = gained(pass.image[std::size_t(c) * pass.pixel_count() + i], a[c], B);
        photo.pixels[3 * i + std::size_t(c)] =
            std::uint8_t(std::lround(255 * std::min(value, 1.0f)));
      }
    }
    View view{"view " + std::to_string(10 + k), camera, photo};
    view.camera_id = std::uint32_t(k % kCameras);
    scene.train_views.push_back(view);
  }
  scene.extent = camera_extent(scene.train_views);
  return scene;
}

Config gains_run(int steps) {
  Config config = short_run();
  config.train.iterations = steps;
  config.density.until_step = 0;
  config.photometric.model = "gains";
  config.photometric.rate = 0.01f;
  return config;
}

class PhotometricRun : public SceneRun {
 protected:
  PhotometricRun() : SceneRun(varied_scene(true, true)) {}
};

TEST_F(PhotometricRun, FindsTheGainsAndTheVignettingOfThePhotos) {
  const TrainingModel model = trained(gains_run(2500));
  const PhotometricState& state = model.photometric;
  for (std::size_t k = 0; k < kViews; ++k)
    for (int c = 0; c < 3; ++c)
      EXPECT_NEAR(state.photo(k)[std::size_t(c)], true_log_gain(k)[c], 0.01) << k << " " << c;
  for (std::size_t camera = 0; camera < kCameras; ++camera) {
    const Span<float> b = state.camera(camera);
    EXPECT_NEAR(log_vignetting<float>({b[0], b[1], b[2]}, 1), true_log_vignetting(camera, 1), 0.01)
        << camera;
  }
}

TEST_F(PhotometricRun, GoesOnWhereItWasStopped) {
  Config config = gains_run(60);
  expect_goes_on_after({1, 29, 59}, config);
  config.train.batch = 4;
  config.train.resolution_ramp = {2};
  expect_goes_on_after({24, 40}, config);
}

TEST_F(PhotometricRun, GivesTheSameBitsForAnyNumberOfThreads) {
  Config config = gains_run(40);
  config.train.batch = 3;
  set_thread_count(1);
  const TrainingModel one = trained(config);
  set_thread_count(3);
  const TrainingModel three = trained(config);
  set_thread_count(0);
  EXPECT_TRUE(same_bits(three, one));
  EXPECT_FALSE(one.photometric.empty());
}

TEST_F(PhotometricRun, BeginsWithTheExposuresThatWereSolvedFor) {
  Scene scene = varied_scene(true, true);
  for (std::size_t k = 0; k < kViews; ++k)
    for (int c = 0; c < 3; ++c)
      scene.train_views[k].exposure[c] = std::exp(true_log_gain(k)[c] + 0.1f);
  Trainer trainer(scene, gains_run(10), *backend_);
  const PhotometricState& state = trainer.model().photometric;
  EXPECT_TRUE(state.is_solved);
  for (std::size_t k = 0; k < kViews; ++k)
    for (int c = 0; c < 3; ++c)
      EXPECT_NEAR(state.photo(k)[std::size_t(c)], true_log_gain(k)[c], 1e-5);
}

// A batch of the same photo twice is one photo.
TEST_F(PhotometricRun, TakesTheMeanGradientOfABatch) {
  const auto after = [&](std::vector<std::size_t> views) {
    Trainer trainer(scene_, gains_run(10), *backend_);  // gives the backend its model
    TrainingModel model = copy_to(host_memory(), trainer.model());
    std::vector<TrainingPhoto> batch;
    for (const std::size_t view : views)
      batch.push_back({&scene_.train_views[view], {}, 1, view, view % kCameras});
    Update update;
    for_each_array([](const char*, float& rate) { rate = 1e-3f; }, update.rates);
    update.photometric_rate = 1e-3f;
    backend_->step(model, {batch.data(), batch.size()}, {0.2f}, update, {});
    return model;
  };
  EXPECT_TRUE(same_bits(after({3, 3}), after({3})));
  const TrainingModel a = after({1}), b = after({4}), both = after({1, 4});
  for (std::size_t i = 0; i < both.photometric.shape.size(); ++i)
    EXPECT_NEAR(both.photometric.first_moment[i],
                (a.photometric.first_moment[i] + b.photometric.first_moment[i]) / 2, 1e-7);
}

TEST_F(PhotometricRun, WithoutVignettingLearnsGainsAlone) {
  Config config = gains_run(30);
  config.photometric.vignetting = false;
  const TrainingModel model = trained(config);
  EXPECT_EQ(model.photometric.shape, (PhotometricShape{kViews, 3, kCameras, 0}));
  EXPECT_NE(model.photometric.photo(0)[0], 0);
}

TEST_F(PhotometricRun, RestsWhereItsRateIsZeroAndElseLeavesOtherRunsAsTheyAre) {
  Config config = gains_run(30);
  config.photometric.model = "none";
  const TrainingModel none = trained(config);
  EXPECT_TRUE(none.photometric.empty());
  config.photometric.rate = 0.5f;  // of no model
  EXPECT_TRUE(same_bits(trained(config), none));
}

/// A backend without photometric models, as one on a GPU.
class OtherBackend final : public Backend {
 public:
  OtherBackend() : Backend(host_memory()) {}
  std::string name() const override { return "other"; }
  Memory& memory() override { return host_memory(); }
  Renderer& renderer() override { return scalar_->renderer(); }
  void use_loss(const std::string& kind) override { scalar_->use_loss(kind); }
  Loss& loss() override { return scalar_->loss(); }
  Optimizer& optimizer() override { return scalar_->optimizer(); }
  RowOps& rows() override { return scalar_->rows(); }

 protected:
  void find_pixel_values(const View&, const DensityStep&, RenderPass&) override {}
  void gather(const DensityStatistics&, const RenderPass&, Span<const Vec2f>,
              ScorePooling) override {}
  void add(Span<float>, Span<const float>, float) override {}
  void pool(Span<FragmentSums>, Span<FragmentSums>, ScorePooling) override {}

 private:
  std::unique_ptr<Backend> scalar_ = make_scalar_backend();
};

TEST_F(PhotometricRun, IsRefusedByABackendWithoutItsStages) {
  OtherBackend other;
  try {
    Trainer trainer(scene_, gains_run(10), other);
    FAIL();
  } catch (const UsageError& error) {
    EXPECT_THAT(error.what(),
                testing::HasSubstr("not there on other yet; train with --device cpu"));
  }
  Config none = gains_run(10);
  none.photometric.model = "none";
  Trainer trainer(scene_, none, other);
}

}  // namespace
}  // namespace gs
