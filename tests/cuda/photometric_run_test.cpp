// SPDX-License-Identifier: Apache-2.0
// Whole runs on the GPU with photometric models. Their steps are in photometric_test.cpp.
#include "gs_eval/metrics.h"
#include "gs_train/loop/trainer.h"
#include "tests/support/cuda.h"
#include "tests/support/gains.h"
#include "tests/support/scene_run.h"
#include "tests/support/wall_scene.h"

namespace gs {
namespace {

class CudaPhotometricRun : public CudaTest {
 protected:
  TrainingModel trained(const Config& config) { return model_of_run(scene_, config, gpu()); }
  const Scene scene_ = wall_scene(true);
};

TEST_F(CudaPhotometricRun, FindsTheGainsOfThePhotos) {
  for (const int batch : {1, 4}) {
    Config config = of_known_shape(gains_run(batch == 1 ? 4000 : 6000));
    config.train.batch = batch;
    Trainer trainer(scene_, config, gpu(), gray_wall(config));
    trainer.run();
    const TrainingModel model = on_host(trainer.model());
    EXPECT_LT(gain_error(model.photometric), 0.005) << batch;
  }
}

// Also in batches, and on reduced photos.
TEST_F(CudaPhotometricRun, GoesOnWhereItWasStopped) {
  for (const int batch : {1, 4}) {
    Config config = gains_run(90);
    config.train.deterministic = true;
    config.train.batch = batch;
    config.train.resolution_ramp = {2};
    config.train.resolution_every = 10000;  // 30 steps
    config.train.resolution_least = 1;
    const TrainingModel expected = trained(config);
    EXPECT_FALSE(expected.photometric.empty());
    for (const int stop : {5, 29, 60})
      EXPECT_TRUE(same_bits(resumed_after(stop, scene_, config, gpu()), expected))
          << "stopped after " << stop << ", batch " << batch;
  }
}

// The photos were multiplied by gains; a run without a model ends 3 dB and more below.
TEST_F(CudaPhotometricRun, LeavesTheSceneItsOwnColors) {
  const Scene neutral = wall_scene(false);
  const auto psnr = [&](const char* model) {
    Config config = gains_run(1500);
    config.photometric.model = model;
    Trainer trainer(scene_, config, gpu());
    trainer.run();
    return evaluate(gpu().renderer(), trainer.model().gaussians.span(), neutral.train_views, {})
        .psnr;
  };
  EXPECT_GT(psnr("gains"), psnr("none") + 3);
}

// Solved exposures, resets of opacity and a growing model: gains rest after each reset.
TEST_F(CudaPhotometricRun, LearnsWhereTheModelGrows) {
  Scene scene = scene_;
  for (std::size_t k = 0; k < kWallViews; ++k)
    for (int c = 0; c < 3; ++c) scene.train_views[k].exposure[c] = std::exp(true_log_gain(k)[c]);
  Config config = short_run();
  config.train.iterations = 600;
  config.density.from_step = config.density.every = 50;
  config.density.gradient_threshold = 1e-5f;
  config.density.reset_opacity_every = 200;
  config.photometric.model = "gains";
  config.photometric.rate = 2e-3f;  // the default when the bound below was chosen
  Trainer trainer(scene, config, gpu());
  trainer.run();
  EXPECT_EQ(gpu().rows().count_not_finite(trainer.model()), 0u);
  const PhotometricState state = copy_to(host_memory(), trainer.model().photometric);
  EXPECT_TRUE(state.is_solved);
  EXPECT_GT(state.adam_steps, 0);
  for (std::size_t k = 0; k < kWallViews; ++k)
    for (std::size_t c = 0; c < 3; ++c) EXPECT_NEAR(state.row(k)[c], true_log_gain(k)[int(c)], 0.1);
}

}  // namespace
}  // namespace gs
