// SPDX-License-Identifier: Apache-2.0
// Runs with Gaussians in space and time: they learn a scene that changes, repeat to the last bit, go
// on from any step, and obey the rules of density control in time, too.
#include "gs_train/row_rules.h"
#include "tests/support/scene_run.h"

namespace gs {
namespace {

/// The small scene, whose photos fade to black in its second half.
Scene fading_scene() {
  Scene scene = small_scene();
  const std::size_t count = scene.train_views.size();
  for (std::size_t i = 0; i < count; ++i) {
    View& view = scene.train_views[i];
    view.camera.time = float(i) / float(count - 1);
    if (view.camera.time > 0.5f)
      for (std::uint8_t& value : view.photo.pixels) value /= 4;
  }
  scene.time_count = count;
  return scene;
}

Config dynamic_run() {
  Config config = growing_run(200);
  config.model.dynamic = true;
  config.density.time_scale_regularizer = 1e-5f;
  config.density.velocity_regularizer = 1e-5f;
  config.train.checkpoint_every = 10;
  return config;
}

Config dynamic_mcmc_run() {
  Config config = dynamic_run();
  config.density.strategy = "mcmc";
  config.density.max_gaussians = 80;
  config.density.growth = 0.2f;
  return config;
}

class DynamicRun : public SceneRun {
 protected:
  DynamicRun() : SceneRun(fading_scene()) {}
};

TEST_F(DynamicRun, LearnsWhatAStaticOneCannot) {
  Config config = dynamic_run();
  const double moving = psnr_after(config);
  config.model.dynamic = false;
  EXPECT_GT(moving, psnr_after(config) + 3);
}

// On a scene that stands still nothing ends the growth of the scales in time but their limit.
class DynamicRunOfAStillScene : public SceneRun {
 protected:
  DynamicRunOfAStillScene() : SceneRun(small_scene()) {}
};

TEST_F(DynamicRunOfAStillScene, StaysFiniteAndLosesLittle) {
  Config config = dynamic_run();
  config.optimizer.log_time_scale_lr = 0.05f;
  const double dynamic = psnr_after(config);
  config.model.dynamic = false;
  EXPECT_GT(dynamic, psnr_after(config) - 1);
}

TEST_F(DynamicRun, GivesTheSameBitsForAnyNumberOfThreads) {
  for (const Config& config : {dynamic_run(), dynamic_mcmc_run()}) {
    const TrainingModel one = trained(config);
    EXPECT_TRUE(one.gaussians.has_time);
    EXPECT_EQ(one.gaussians.time_mean.size(), one.count());
    expect_same_bits_on_any_threads(config);
  }
}

TEST_F(DynamicRun, StoppedAndResumedEndsWithTheSameBits) {
  for (const Config& config : {dynamic_run(), dynamic_mcmc_run()})
    expect_goes_on_after({19, 63, 150}, config);
}

TEST(RowRules, HalvesOfASplitMoveInTimeAndLiveShorter) {
  Gaussians rows(1, host_memory(), true);
  set_gaussian(rows, 0, {0, 0, 0}, 1e-3f, 0.5f);
  rows.right_rotation[0] = {1, 0, 0, 0};
  rows.time_mean[0] = 0.5f;
  rows.log_time_scale[0] = std::log(0.1f);
  double sum = 0, squares = 0;
  constexpr int kDraws = 2000;
  for (std::uint32_t k = 0; k < kDraws; ++k) {
    const HalfRow half = half_of(rows.span(), 0, k, {1, RandomStream::split_gaussians}, 7);
    EXPECT_FLOAT_EQ(half.log_time_scale, std::log(0.1f / kSplitScaleDivisor));
    sum += half.time_mean - 0.5;
    squares += (half.time_mean - 0.5) * (half.time_mean - 0.5);
  }
  EXPECT_NEAR(sum / kDraws, 0, 0.01);
  EXPECT_NEAR(std::sqrt(squares / kDraws), 0.1, 0.01);
}

TEST(RowRules, ARowWithoutAMomentIsPrunedAndNeverDrawn) {
  const AdaptiveRules rules{1, 0.1f, 0.05f, std::numeric_limits<float>::infinity(), 0};
  Gaussians rows(3, host_memory(), true);
  for (std::size_t i = 0; i < 3; ++i) {
    set_gaussian(rows, i, {0, 0, 0}, 0.1f, 0.5f);
    rows.right_rotation[i] = {1, 0, 0, 0};
    rows.time_mean[i] = rows.log_time_scale[i] = 0;
  }
  rows.right_rotation[1] = {0, 0, 0, 0};
  rows.log_time_scale[2] = std::numeric_limits<float>::quiet_NaN();
  for (std::size_t i = 0; i < 3; ++i) {
    EXPECT_EQ(is_pruned(rows.span(), i, rules), i > 0) << i;
    EXPECT_EQ(draw_weight(rows.span(), i, 0.005f) == 0, i > 0) << i;
  }
}

}  // namespace
}  // namespace gs
