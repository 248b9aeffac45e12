// SPDX-License-Identifier: Apache-2.0
// Runs with a photometric model on a rendered scene whose photos are multiplied by known gains.
#include "tests/support/scene_run.h"
#include "tests/support/wall_scene.h"

namespace gs {
namespace {

class PhotometricRun : public SceneRun {
 protected:
  PhotometricRun() : SceneRun(wall_scene(true)) {}

  /// Of the neutral pictures against photos without gains.
  double neutral_psnr(const TrainingModel& model) {
    return evaluate(backend_->renderer(), model.gaussians.span(), wall_scene(false).train_views, {})
        .psnr;
  }
};

TEST_F(PhotometricRun, FindsTheGainsOfThePhotos) {
  for (const int batch : {1, 4}) {
    Config config = of_known_shape(gains_run(batch == 1 ? 4000 : 6000));
    config.train.batch = batch;
    Trainer trainer(scene_, config, *backend_, gray_wall(config));
    trainer.run();
    EXPECT_LT(gain_error(trainer.model().photometric), 0.005) << batch;
  }
}

// Photos of a scene whose shape is learned, too, leave some freedom: a Gaussian that few photos see
// takes a part of their gains.
TEST_F(PhotometricRun, FindsThemNearlyAsWellFromPointsAlone) {
  Config config = gains_run(6000);
  const TrainingModel model = trained(config);
  EXPECT_LT(gain_error(model.photometric), 0.03);
}

TEST_F(PhotometricRun, LeavesTheSceneItsOwnColors) {
  const double with = neutral_psnr(trained(gains_run(1500)));
  Config config = gains_run(1500);
  config.photometric.model = "none";
  EXPECT_GT(with, neutral_psnr(trained(config)) + 3);
}

// No light changes here.
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
  expect_same_bits_on_any_threads(config);
}

TEST_F(PhotometricRun, BeginsWithTheExposuresThatWereSolvedFor) {
  Scene scene = wall_scene(true);
  for (std::size_t k = 0; k < kWallViews; ++k)
    for (int c = 0; c < 3; ++c)
      scene.train_views[k].exposure[c] = std::exp(true_log_gain(k)[c] + 0.1f);
  Trainer trainer(scene, gains_run(10), *backend_);
  const PhotometricState& state = trainer.model().photometric;
  EXPECT_TRUE(state.is_solved);
  for (std::size_t k = 0; k < kWallViews; ++k)
    for (int c = 0; c < 3; ++c)
      EXPECT_NEAR(state.row(k)[std::size_t(c)], true_log_gain(k)[c], 1e-5);
}

// A batch of the same photo twice is one photo.
TEST_F(PhotometricRun, TakesTheMeanGradientOfABatch) {
  const auto after = [&](std::vector<std::size_t> views) {
    Trainer trainer(scene_, gains_run(10), *backend_);  // gives the backend its model
    TrainingModel model = copy_to(host_memory(), trainer.model());
    std::vector<TrainingPhoto> batch;
    for (const std::size_t view : views) batch.push_back({&scene_.train_views[view], {}, 1, view});
    Update update;
    for_each_array([](const char*, float& rate) { rate = 1e-3f; }, update.rates);
    update.photometric_rate = 1e-3f;
    backend_->step(model, {{batch.data(), batch.size()}, {0.2f}, update, {}});
    return model;
  };
  EXPECT_TRUE(same_bits(after({3, 3}), after({3})));
  const TrainingModel a = after({1}), b = after({4}), both = after({1, 4});
  for (std::size_t i = 0; i < both.photometric.size(); ++i)
    EXPECT_NEAR(both.photometric.moments[i].first,
                (a.photometric.moments[i].first + b.photometric.moments[i].first) / 2, 1e-7);
}

TEST_F(PhotometricRun, RestsWhereItsRateIsZeroAndElseLeavesOtherRunsAsTheyAre) {
  Config config = gains_run(30);
  config.photometric.model = "none";
  const TrainingModel none = trained(config);
  EXPECT_TRUE(none.photometric.empty());
  config.photometric.rate = 0.5f;  // of no model
  EXPECT_TRUE(same_bits(trained(config), none));
}

}  // namespace
}  // namespace gs
