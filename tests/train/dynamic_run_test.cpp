// SPDX-License-Identifier: Apache-2.0
// Runs with Gaussians in space and time: they learn a scene that changes, repeat to the last bit, go
// on from any step, and obey the rules of density control in time, too.
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "gs_core/math/morton.h"
#include "gs_core/threads/parallel.h"
#include "gs_train/loop/trainer.h"
#include "gs_train/metrics.h"
#include "gs_train/row_rules.h"
#include "tests/support/models.h"
#include "tests/support/small_scene.h"

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
  Config config = short_run();
  config.model.dynamic = true;
  config.train.iterations = 200;
  config.density.from_step = config.density.every = 20;
  config.density.gradient_threshold = 1e-5f;
  config.density.time_scale_regularizer = 1e-5f;
  config.density.velocity_regularizer = 1e-5f;
  config.train.time_noise = 0.1f;
  config.train.checkpoint_every = 10;
  config.train.morton_every = 1000;
  return config;
}

Config dynamic_mcmc_run() {
  Config config = dynamic_run();
  config.density.strategy = "mcmc";
  config.density.max_gaussians = 80;
  config.density.growth = 0.2f;
  return config;
}

class LastState : public CheckpointStore {
 public:
  bool save(const RunProgress& progress, const TrainingModel& model) override {
    state_ = {progress, copy_to(host_memory(), model)};
    return true;
  }
  std::optional<TrainingState> newest() override {
    return TrainingState{state_.progress, copy_to(host_memory(), state_.model)};
  }

 private:
  TrainingState state_;
};

class StopAfter : public Observer {
 public:
  explicit StopAfter(int step) : step_(step) {}
  void after_step(int step, Trainer& trainer) override {
    if (step == step_) trainer.stop();
  }

 private:
  int step_;
};

class DynamicRun : public ::testing::Test {
 protected:
  TrainingModel trained(const Config& config) {
    Trainer trainer(scene_, config, *backend_);
    trainer.run();
    return copy_to(host_memory(), trainer.model());
  }
  double psnr_after(const Config& config) {
    Trainer trainer(scene_, config, *backend_);
    trainer.run();
    return evaluate(backend_->renderer(), trainer.model().gaussians.span(), scene_.train_views,
                    trainer.evaluation_settings())
        .psnr;
  }

  const Scene scene_ = fading_scene();
  const std::unique_ptr<Backend> backend_ = make_scalar_backend();
};

TEST_F(DynamicRun, LearnsWhatAStaticOneCannot) {
  Config config = dynamic_run();
  const double moving = psnr_after(config);
  config.model.dynamic = false;
  EXPECT_GT(moving, psnr_after(config) + 3);
}

// On a scene that stands still nothing ends the growth of the scales in time but their limit.
TEST(DynamicRunOfAStillScene, StaysFiniteAndLosesLittle) {
  const Scene scene = small_scene();
  const auto backend = make_scalar_backend();
  const auto psnr_after = [&](const Config& config) {
    Trainer trainer(scene, config, *backend);
    trainer.run();
    EXPECT_EQ(backend->rows().count_not_finite(trainer.model()), 0u);
    return evaluate(backend->renderer(), trainer.model().gaussians.span(), scene.train_views,
                    trainer.evaluation_settings())
        .psnr;
  };
  Config config = dynamic_run();
  config.optimizer.log_time_scale_lr = 0.05f;
  const double dynamic = psnr_after(config);
  config.model.dynamic = false;
  EXPECT_GT(dynamic, psnr_after(config) - 1);
}

TEST_F(DynamicRun, GivesTheSameBitsForAnyNumberOfThreads) {
  for (const Config& config : {dynamic_run(), dynamic_mcmc_run()}) {
    set_thread_count(1);
    const TrainingModel one = trained(config);
    EXPECT_TRUE(one.gaussians.has_time);
    EXPECT_EQ(one.gaussians.time_mean.size(), one.count());
    set_thread_count(0);
    EXPECT_TRUE(same_bits(trained(config), one));
  }
}

TEST_F(DynamicRun, StoppedAndResumedEndsWithTheSameBits) {
  for (const Config& config : {dynamic_run(), dynamic_mcmc_run()}) {
    const TrainingModel expected = trained(config);
    for (const int stop : {19, 63, 150}) {
      LastState kept;
      StopAfter stopper(stop);
      Trainer first(scene_, config, *backend_);
      first.keep_checkpoints_in(kept);
      first.add_observer(stopper);
      first.run();
      Trainer second(scene_, config, *backend_, *kept.newest());
      second.run();
      EXPECT_TRUE(same_bits(second.model(), expected)) << config.density.strategy << " " << stop;
    }
  }
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

TEST(TimeBins, ComeBeforePlacesInTheMortonOrder) {
  const std::uint64_t far = (std::uint64_t(1) << 63) - 1;
  EXPECT_LT(time_binned(far, 0.49f), time_binned(0, 0.51f));
  EXPECT_LT(time_binned(0, 0.49f), time_binned(far, 0.49f));
  EXPECT_EQ(time_binned(0, 1.0f), time_binned(0, 7.0f));
  EXPECT_EQ(time_binned(0, std::numeric_limits<float>::quiet_NaN()), 0u);
  EXPECT_LT(time_binned(far, 1.0f), std::uint64_t(1) << 63);
}

}  // namespace
}  // namespace gs
