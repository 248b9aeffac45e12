// SPDX-License-Identifier: Apache-2.0
// Runs that refine disturbed poses.
#include "tests/support/posed_scene.h"
#include "tests/support/scene_run.h"

namespace gs {
namespace {

class PosesRun : public SceneRun {
 protected:
  PosesRun() : SceneRun({}) { scene_ = posed_.disturbed; }
  double test_psnr(Trainer& trainer) {
    return psnr_of(*backend_, trainer, posed_.given.test_views);
  }
  PoseError error_of(Trainer& trainer, const Scene& scene) {
    return pose_error(refined_cameras(trainer.model().poses, scene.train_views), posed_.truth);
  }
  PoseError error_of(Trainer& trainer) { return error_of(trainer, scene_); }
  const PosedScene posed_ = posed_scene();
};

TEST_F(PosesRun, BeginsWithPosesThatAreOff) {
  Trainer trainer(scene_, posed_run(1), *backend_);
  EXPECT_GT(error_of(trainer).degrees, 0.4);
  EXPECT_GT(error_of(trainer).shift, 0.008 * posed_.given.extent);
}

TEST_F(PosesRun, BringsPosesBackToATenthWhereTheGaussiansAreKnown) {
  const Config config = of_known_gaussians(refining_run(kPosedSteps));
  Trainer trainer(scene_, config, *backend_, state_of_truth(posed_, config));
  trainer.run();
  EXPECT_LT(error_of(trainer).degrees, 0.05);
  EXPECT_LT(error_of(trainer).shift, 0.001 * posed_.given.extent);
}

TEST_F(PosesRun, MakesUpForTheDisturbanceWhereAllIsLearned) {
  Trainer given(posed_.given, posed_run(kPosedSteps), *backend_);
  given.run();
  Trainer disturbed(scene_, posed_run(kPosedSteps), *backend_);
  disturbed.run();
  EXPECT_LT(test_psnr(disturbed), test_psnr(given) - 5);
  Trainer refined(scene_, refining_run(kPosedSteps), *backend_);
  refined.run();
  EXPECT_GT(test_psnr(refined), test_psnr(given) - 0.5);  // of 5 that the disturbance costs
  EXPECT_LT(error_of(refined).degrees, 0.2);
  EXPECT_LT(error_of(refined).shift, 0.003 * posed_.given.extent);
}

TEST_F(PosesRun, LeavesPosesThatAreRightNearlyAlone) {
  Trainer trainer(posed_.given, refining_run(3000), *backend_);
  trainer.run();
  const PoseError left = error_of(trainer, posed_.given);
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
    expect_goes_on_after({5, 29, 60}, config);
  }
}

TEST_F(PosesRun, HasTheSameBitsWithAnyNumberOfThreads) {
  expect_same_bits_on_any_threads(refining_run(60));
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
