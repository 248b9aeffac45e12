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

constexpr std::size_t kViews = 24, kCameras = 3;

/// Photo k shows exp(a - B) times the scene, with gains of up to half a stop. They jump from photo to
/// photo, as no color that changes with the direction does; and the mean of each channel is 0.
Vec3f true_log_gain(std::size_t k) {
  constexpr int kJumps[kViews] = {5, -3, 1, -5, 4, -1, 3, -4, 0,  2, 2,  -4,
                                  4, -2, 3, -5, 1, 0,  5, -3, -4, 2, -1, 0};
  const auto jump = [&](std::size_t i) { return 0.07f * float(kJumps[i % kViews]); };
  return {jump(k), jump(5 * k + 3), jump(7 * k + 1)};
}

/// cos^4 of the angle from the axis, for three lenses. The corners of the widest are at 40 degrees.
float true_log_vignetting(std::size_t camera, float rho) {
  constexpr float kTan2[kCameras] = {0, 0.3f, 0.7f};
  return 2 * std::log1p(kTan2[camera] * rho);
}

/// A wall that fills the pictures to their corners, dark enough to be multiplied.
Gaussians wall() {
  Draws draws(5);
  Gaussians truth(400, host_memory());
  for (std::size_t i = 0; i < truth.count(); ++i) {
    Vec3f place = draws.uniform3(-3.2f, 3.2f);
    place.z *= 0.05f;
    const Vec3f color = draws.uniform3(0.05f, 0.5f);
    set_gaussian(truth, i, place, draws.uniform(0.15f, 0.35f), 0.95f, color);
  }
  return truth;
}

/// Each camera sees another part of the wall, so that a lens is no property of the wall.
Camera camera_of(std::size_t k) {
  Camera camera = orbit_camera(0.3f * (float(k) / float(kViews) - 0.5f));
  camera.cam_from_world_translation = {0.25f * float(int(7 * k % 5) - 2),
                                       0.3f * float(int(3 * k % 5) - 2), 4.5f};
  return camera;
}

Image8 photo_of(const RenderPass& pass, const Camera& camera, std::size_t k, bool is_varied) {
  const LensPlace place = lens_place(camera.cx, camera.cy, camera.width, camera.height, 1);
  const Vec3f a = is_varied ? true_log_gain(k) : Vec3f(0);
  Image8 photo(camera.width, camera.height, 3);
  for (int y = 0; y < camera.height; ++y)
    for (int x = 0; x < camera.width; ++x) {
      const float rho = place.rho(float(x) + 0.5f, float(y) + 0.5f);
      const float B = is_varied ? true_log_vignetting(k % kCameras, rho) : 0.0f;
      const std::size_t i = std::size_t(y) * std::size_t(camera.width) + std::size_t(x);
      for (int c = 0; c < 3; ++c) {
        const float value = gained(pass.image[std::size_t(c) * pass.pixel_count() + i], a[c], B);
        photo.at(x, y, c) = std::uint8_t(std::lround(255 * std::min(value, 1.0f)));
      }
    }
  return photo;
}

Scene wall_scene(bool is_varied) {
  Scene scene;
  scene.source = "a scene of the test";
  const Gaussians truth = wall();
  for (const Vec3f& mean : truth.mean) scene.points.push_back({mean, {70, 70, 70}});
  const auto renderer = make_scalar_renderer();
  RenderPass pass;
  for (std::size_t k = 0; k < kViews; ++k) {
    const Camera camera = camera_of(k);
    renderer->forward(truth.span(), camera, {}, pass);
    View view{"view " + std::to_string(10 + k), camera, photo_of(pass, camera, k, is_varied)};
    view.camera_id = std::uint32_t(k % kCameras);
    scene.train_views.push_back(view);
  }
  scene.extent = camera_extent(scene.train_views);
  return scene;
}

/// Gaussians stay as many as they are.
Config gains_run(int steps) {
  Config config;
  config.train.iterations = steps;
  config.model.sh_degree = 0;
  config.density.until_step = config.density.reset_opacity_until = 0;
  config.photometric.model = "gains";
  config.photometric.rate = 0.02f;
  config.photometric.vignetting = true;
  return config;
}

/// B in the corners, from the middle on.
float corner_vignetting(Span<const float> b) {
  const std::array<float, 3> all{b[0], b[1], b[2]};
  return log_vignetting(all, 1.0f) - log_vignetting(all, 0.0f);
}

/// The gains in the middle of the photos, where cos^4 is 1.
std::vector<float> middle_gains(const PhotometricState& state) {
  std::vector<float> gains;
  for (std::size_t k = 0; k < kViews; ++k) {
    const Span<float> b = state.camera(k % kCameras);
    const float middle = log_vignetting<float>({b[0], b[1], b[2]}, 0);
    for (std::size_t c = 0; c < 3; ++c) gains.push_back(state.photo(k)[c] - middle);
  }
  return gains;
}

class PhotometricRun : public SceneRun {
 protected:
  PhotometricRun() : SceneRun(wall_scene(true)) {}

  /// The wall in gray, to start from: colors, gains and vignetting are to be found.
  TrainingState gray_wall(const Config& config) const {
    TrainingState state;
    state.model.gaussians = wall();
    state.model.gaussians.sh0.fill_zero();
    clear_history(state.model);
    state.progress.strikes.assign(kViews, 0);
    ViewSampler views(kViews, config.train.seed);
    views.view_of(1);
    state.progress.view_order = {views.order().begin(), views.order().end()};
    return state;
  }
  /// Of the neutral pictures against photos without gains and vignetting.
  double neutral_psnr(const TrainingModel& model) {
    return evaluate(backend_->renderer(), model.gaussians.span(), wall_scene(false).train_views, {})
        .psnr;
  }
};

/// The worst error of a gain.
double gain_error(const PhotometricState& state) {
  const std::vector<float> gains = middle_gains(state);
  double worst = 0;
  for (std::size_t k = 0; k < kViews; ++k)
    for (int c = 0; c < 3; ++c)
      worst =
          std::max(worst, std::abs(double(gains[3 * k + std::size_t(c)] - true_log_gain(k)[c])));
  return worst;
}
double vignetting_error(const PhotometricState& state) {
  double worst = 0;
  for (std::size_t camera = 0; camera < kCameras; ++camera)
    worst = std::max(worst, std::abs(double(corner_vignetting(state.camera(camera)) -
                                            true_log_vignetting(camera, 1))));
  return worst;
}

TEST_F(PhotometricRun, FindsTheGainsAndTheVignettingOfThePhotos) {
  for (const int batch : {1, 4}) {
    Config config = gains_run(batch == 1 ? 4000 : 6000);
    config.train.batch = batch;
    for (float* rate : {&config.optimizer.position_lr_initial, &config.optimizer.position_lr_final,
                        &config.optimizer.log_scale_lr, &config.optimizer.rotation_lr,
                        &config.optimizer.opacity_lr})
      *rate = 1e-9f;  // where the wall is, is known
    Trainer trainer(scene_, config, *backend_, gray_wall(config));
    trainer.run();
    EXPECT_LT(gain_error(trainer.model().photometric), 0.005) << batch;
    EXPECT_LT(vignetting_error(trainer.model().photometric), 0.01) << batch;
  }
}

// Photos of a scene whose shape is learned, too, leave some freedom: a Gaussian that few photos see
// takes a part of their gains.
TEST_F(PhotometricRun, FindsThemNearlyAsWellFromPointsAlone) {
  Config config = gains_run(6000);
  const TrainingModel model = trained(config);
  EXPECT_LT(gain_error(model.photometric), 0.03);
  EXPECT_LT(vignetting_error(model.photometric), 0.05);
}

TEST_F(PhotometricRun, LeavesTheSceneItsOwnColors) {
  const double with = neutral_psnr(trained(gains_run(1500)));
  Config config = gains_run(1500);
  config.photometric.model = "none";
  EXPECT_GT(with, neutral_psnr(trained(config)) + 3);
}

// No light changes here. Some lies in the rims while the wall is still gray, and goes away slowly.
TEST_F(PhotometricRun, CostsLittleWherePhotosDoNotDiffer) {
  const Scene plain = wall_scene(false);
  const auto psnr_of = [&](const char* model) {
    Config config = gains_run(1500);
    config.photometric.model = model;
    config.photometric.rate = PhotometricConfig().rate;
    Trainer trainer(plain, config, *backend_);
    trainer.run();
    return neutral_psnr(copy_to(host_memory(), trainer.model()));
  };
  EXPECT_GT(psnr_of("gains"), psnr_of("none") - 1);
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
  Scene scene = wall_scene(true);
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
