// SPDX-License-Identifier: Apache-2.0
// Runs that refine disturbed poses.
#include <gmock/gmock.h>

#include "gs_core/threads/parallel.h"
#include "tests/support/posed_scene.h"
#include "tests/support/scene_run.h"

namespace gs {
namespace {

class PosesRun : public ::testing::Test {
 protected:
  double test_psnr(Trainer& trainer) {
    return evaluate(backend_->renderer(), trainer.model().gaussians.span(), posed_.given.test_views,
                    trainer.evaluation_settings())
        .psnr;
  }
  PoseError error_of(Trainer& trainer) {
    return pose_error(refined_cameras(trainer.model().poses, posed_.disturbed.train_views),
                      posed_.truth);
  }
  TrainingModel trained(const Config& config) {
    return model_of_run(posed_.disturbed, config, *backend_);
  }

  const PosedScene posed_ = posed_scene();
  const std::unique_ptr<Backend> backend_ = make_scalar_backend();
};

TEST_F(PosesRun, BeginsWithPosesThatAreOff) {
  Trainer trainer(posed_.disturbed, posed_run(1), *backend_);
  EXPECT_GT(error_of(trainer).degrees, 0.4);
  EXPECT_GT(error_of(trainer).shift, 0.008 * posed_.given.extent);
}

TEST_F(PosesRun, BringsPosesBackToATenthWhereTheGaussiansAreKnown) {
  const Config config = of_known_gaussians(refining_run(kPosedSteps));
  Trainer trainer(posed_.disturbed, config, *backend_, state_of_truth(posed_, config));
  trainer.run();
  EXPECT_LT(error_of(trainer).degrees, 0.05);
  EXPECT_LT(error_of(trainer).shift, 0.001 * posed_.given.extent);
}

TEST_F(PosesRun, MakesUpForTheDisturbanceWhereAllIsLearned) {
  Trainer given(posed_.given, posed_run(kPosedSteps), *backend_);
  given.run();
  Trainer disturbed(posed_.disturbed, posed_run(kPosedSteps), *backend_);
  disturbed.run();
  EXPECT_LT(test_psnr(disturbed), test_psnr(given) - 5);
  Trainer refined(posed_.disturbed, refining_run(kPosedSteps), *backend_);
  refined.run();
  EXPECT_GT(test_psnr(refined), test_psnr(given) - 0.2);
  EXPECT_LT(error_of(refined).degrees, 0.2);
  EXPECT_LT(error_of(refined).shift, 0.003 * posed_.given.extent);
}

TEST_F(PosesRun, LeavesPosesThatAreRightNearlyAlone) {
  Trainer trainer(posed_.given, refining_run(3000), *backend_);
  trainer.run();
  const PoseError left =
      pose_error(refined_cameras(trainer.model().poses, posed_.given.train_views), posed_.truth);
  EXPECT_LT(left.degrees, 0.2);
  EXPECT_LT(left.shift, 0.003 * posed_.given.extent);
}

// Also in batches, and on reduced photos.
TEST_F(PosesRun, GoesOnWhereItWasStopped) {
  for (const int batch : {1, 4}) {
    Config config = refining_run(90);
    config.train.batch = batch;
    config.train.resolution_ramp = {2};
    config.train.resolution_every = 10000;  // 30 steps
    config.train.resolution_least = 1;
    const TrainingModel expected = trained(config);
    EXPECT_GT(expected.poses.adam_steps, 0);
    for (const int stop : {5, 29, 60})
      EXPECT_TRUE(same_bits(resumed_after(stop, posed_.disturbed, config, *backend_), expected))
          << stop << ", batch " << batch;
  }
}

TEST_F(PosesRun, HasTheSameBitsWithAnyNumberOfThreads) {
  const int threads = thread_count();
  const TrainingModel expected = trained(refining_run(60));
  set_thread_count(threads == 1 ? 3 : 1);
  EXPECT_TRUE(same_bits(trained(refining_run(60)), expected));
  set_thread_count(threads);
}

TEST_F(PosesRun, RestsAfterAnOpacityReset) {
  Config config = refining_run(1200);
  config.density.gradient_threshold = 1;  // nothing grows
  config.density.until_step = config.density.reset_opacity_until = 30000;
  config.density.reset_opacity_every = 300;
  const TrainingModel model = trained(config);
  EXPECT_LT(model.poses.adam_steps, model.adam_steps - 200);
  EXPECT_GT(model.poses.adam_steps, 400);
}

TEST_F(PosesRun, IsTheSameWithoutTheSetting) {
  Config config = posed_run(40), other = posed_run(40);
  other.poses.rate = 0.5f;
  const TrainingModel model = trained(config);
  EXPECT_TRUE(model.poses.empty());
  EXPECT_TRUE(same_bits(trained(other), model));
}

}  // namespace
}  // namespace gs
