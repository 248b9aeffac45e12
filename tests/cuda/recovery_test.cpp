// SPDX-License-Identifier: Apache-2.0
// How a run on the GPU survives: states that go through a checkpoint, and memory that runs out at
// any allocation.
#include "tests/support/cuda.h"

namespace gs {
namespace {

Config eventful_run(int steps) {
  Config config = growing_run(steps);
  config.train.checkpoint_every = 10;
  return config;
}

class CudaRecovery : public CudaTest {
 protected:
  const Scene scene_ = small_scene();
};

TEST_F(CudaRecovery, AStoppedAndResumedDeterministicRunEndsAsOneNeverInterrupted) {
  Config config = eventful_run(250);
  config.train.deterministic = true;
  EXPECT_TRUE(
      same_bits(resumed_after(117, scene_, config, gpu()), model_of_run(scene_, config, gpu())));
}

// Within a factor of the ramp, and right before and after its end; also in batches. What is learned of
// photos and poses comes back, too.
TEST_F(CudaRecovery, AResumedRunOnReducedPhotosEndsAsOneNeverInterrupted) {
  for (const int batch : {1, 4}) {
    Config config = eventful_run(90);
    config.photometric.model = "gains";
    config.poses.refine = true;
    config.train.deterministic = true;
    config.train.resolution_ramp = {4, 2};
    config.train.resolution_every = 10000;  // 30 steps
    config.train.resolution_least = 1;
    config.train.batch = batch;
    const TrainingModel whole = model_of_run(scene_, config, gpu());
    for (const int stop : {12, 29, 30, 58, 70})
      EXPECT_TRUE(same_bits(resumed_after(stop, scene_, config, gpu()), whole))
          << stop << ", batches of " << batch;
  }
}

TEST_F(CudaRecovery, AStateComesBackFromTheGpuBitForBit) {
  const Config config = eventful_run(40);
  KeptStates kept;
  Trainer trainer(scene_, config, gpu());
  trainer.keep_checkpoints_in(kept);
  trainer.run();
  Trainer again(scene_, config, gpu(), *kept.newest());
  EXPECT_TRUE(same_bits(on_host(again.model()), kept.states.back().model));
}

TEST_F(CudaRecovery, RowsThatAreNotFiniteAreCountedAsOnTheCpu) {
  TrainingModel model = model_of(small_truth());
  model.gaussians.mean[3].y = kNan;
  model.gaussians.sh_rest[3].coefficient[14].z = kNan;  // the same row
  model.gaussians.sh_rest[17].coefficient[0].x = std::numeric_limits<float>::infinity();
  model.gaussians.logit_opacity[39] = -kNan;
  EXPECT_EQ(cpu().rows().count_not_finite(model), 3u);
  EXPECT_EQ(gpu().rows().count_not_finite(on_gpu(model)), 3u);
}

TEST_F(CudaRecovery, RowOperationsChangeNothingWhereMemoryRunsOut) {
  const AdaptiveRules rules{1e-6f, 0.1f, 0.05f, std::numeric_limits<float>::infinity(), 0};
  TrainingModel start = model_of(small_truth());
  for (float& norm : start.statistics.gradient_norm) norm = 1;
  const auto grow = [&](TrainingModel& model) {
    gpu().rows().grow(model, GrowthRules{rules}, 1, 5);
  };
  const auto prune = [&](TrainingModel& model) { gpu().rows().prune(model, 0.7f); };
  const auto sort = [&](TrainingModel& model) { gpu().rows().sort_by_morton(model); };
  for (const std::function<void(TrainingModel&)>& operation :
       {std::function<void(TrainingModel&)>(grow), std::function<void(TrainingModel&)>(prune),
        std::function<void(TrainingModel&)>(sort)})
    for (int k = 1;; ++k) {
      TrainingModel model = on_gpu(start);
      gpu().release_caches();
      FailingMemory memory(k);
      bool has_thrown = false;
      try {
        operation(model);
      } catch (const Error&) {
        has_thrown = true;
      }
      set_allocation_hook(nullptr);
      EXPECT_TRUE(!has_thrown || same_bits(on_host(model), start)) << k;
      if (!memory.has_failed()) break;
    }
}

// With a photometric model, too, whose buffers are as long as the scene has photos.
TEST_F(CudaRecovery, AFailureOfAnySingleAllocationIsSurvived) {
  for (const char* model : {"none", "gains"})
    for (int k = 1;; ++k) {
      SCOPED_TRACE(testing::Message() << model << ", allocation " << k);
      gpu().release_caches();
      KeptStates kept;
      Config config = eventful_run(45);
      config.photometric.model = model;
      Trainer trainer(scene_, config, gpu());
      trainer.keep_checkpoints_in(kept);
      FailingMemory memory(k);
      ASSERT_NO_THROW(trainer.run());
      const bool has_failed = memory.has_failed();
      set_allocation_hook(nullptr);
      EXPECT_EQ(trainer.step(), 45);
      EXPECT_EQ(trainer.model().adam_steps, 45);
      EXPECT_EQ(gpu().rows().count_not_finite(trainer.model()), 0u);
      EXPECT_GT(psnr_of(gpu(), trainer, scene_.train_views), 12);
      if (!has_failed) break;
    }
}

}  // namespace
}  // namespace gs
