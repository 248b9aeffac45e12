// SPDX-License-Identifier: Apache-2.0
// How a run on the GPU survives: states that go through a checkpoint, and memory that runs out at
// any allocation.
#include <gtest/gtest.h>

#include <functional>
#include <limits>

#include "gs_core/error.h"
#include "gs_eval/metrics.h"
#include "gs_train/loop/trainer.h"
#include "tests/support/cuda.h"
#include "tests/support/scene_run.h"
#include "tests/support/small_scene.h"

namespace gs {
namespace {

constexpr float kNan = std::numeric_limits<float>::quiet_NaN();

int allocations = 0, first_failure = 0;

void fail_on_purpose(std::size_t) {
  if (++allocations == first_failure)
    throw Error("out of memory, says the test", ExitCode::out_of_memory);
}

/// While it lives, one allocation fails; they are counted from its construction on.
class FailingMemory {
 public:
  explicit FailingMemory(int failure) {
    allocations = 0;
    first_failure = failure;
    set_allocation_hook(fail_on_purpose);
  }
  ~FailingMemory() { set_allocation_hook(nullptr); }
  bool has_failed() const { return allocations >= first_failure; }
};

/// The last state, in host memory.
class KeptState final : public CheckpointStore {
 public:
  bool save(const RunProgress& progress, const TrainingModel& model) override {
    set_allocation_hook(nullptr);
    state = TrainingState{progress, copy_to(host_memory(), model)};
    if (first_failure) set_allocation_hook(fail_on_purpose);
    return true;
  }
  std::optional<TrainingState> newest() override {
    if (!state) return std::nullopt;
    return TrainingState{state->progress, copy_to(host_memory(), state->model)};
  }
  std::optional<TrainingState> state;
};

Config eventful_run(int steps) {
  Config config = short_run();
  config.train.iterations = steps;
  config.train.checkpoint_every = 10;
  config.density.from_step = config.density.every = 20;
  config.density.gradient_threshold = 1e-5f;
  return config;
}

class CudaRecovery : public CudaTest {
 protected:
  void SetUp() override {
    CudaTest::SetUp();
    first_failure = 0;
  }
  double psnr_of(Trainer& trainer) {
    return evaluate(gpu().renderer(), trainer.model().gaussians.span(), scene_.train_views,
                    trainer.evaluation_settings())
        .psnr;
  }
  const Scene scene_ = small_scene();
};

// The GPU adds in any order, so the test compares pictures and not bits. A lost moment or statistic
// would cost decibels.
TEST_F(CudaRecovery, AStoppedAndResumedDeterministicRunEndsAsOneNeverInterrupted) {
  Config config = eventful_run(250);
  config.train.deterministic = true;
  Trainer whole(scene_, config, gpu());
  whole.run();
  KeptState kept;
  StopAfter stop(117);
  Trainer first(scene_, config, gpu());
  first.keep_checkpoints_in(kept);
  first.add_observer(stop);
  first.run();
  EXPECT_EQ(kept.state->progress.step, 118);
  EXPECT_EQ(kept.state->model.adam_steps, 118);
  Trainer second(scene_, config, gpu(), *kept.newest());
  second.run();
  EXPECT_TRUE(same_bits(on_host(second.model()), on_host(whole.model())));
}

// Within a factor of the ramp, and right before and after its end; also in batches.
TEST_F(CudaRecovery, AResumedRunOnReducedPhotosEndsAsOneNeverInterrupted) {
  for (const int batch : {1, 4}) {
    Config config = eventful_run(90);
    config.train.deterministic = true;
    config.train.resolution_ramp = {4, 2};
    config.train.resolution_every = 10000;  // 30 steps
    config.train.resolution_least = 1;
    config.train.batch = batch;
    Trainer whole(scene_, config, gpu());
    whole.run();
    for (const int stop_after : {12, 29, 30, 58, 70}) {
      EXPECT_TRUE(
          same_bits(resumed_after(stop_after, scene_, config, gpu()), on_host(whole.model())))
          << stop_after << ", batches of " << batch;
    }
  }
}

TEST_F(CudaRecovery, AStateComesBackFromTheGpuBitForBit) {
  const Config config = eventful_run(40);
  KeptState kept;
  Trainer trainer(scene_, config, gpu());
  trainer.keep_checkpoints_in(kept);
  trainer.run();
  Trainer again(scene_, config, gpu(), *kept.newest());
  EXPECT_TRUE(same_bits(on_host(again.model()), kept.state->model));
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
      KeptState kept;
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
      EXPECT_GT(psnr_of(trainer), 12);
      if (!has_failed) break;
    }
}

}  // namespace
}  // namespace gs
