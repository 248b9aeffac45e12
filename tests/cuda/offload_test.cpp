// SPDX-License-Identifier: Apache-2.0
// SH in host memory that kernels use in place (train.offload): steps, row operations and whole runs
// have the bits of those on the GPU alone, and the GPU holds exactly those arrays less.
#include <gtest/gtest.h>

#include <algorithm>
#include <string>
#include <utility>

#include "gs_core/error.h"
#include "gs_train/loop/offload.h"
#include "tests/cuda/every_form.h"
#include "tests/support/cuda.h"
#include "tests/support/scene_run.h"
#include "tests/support/small_scene.h"

namespace gs {
namespace {

class CudaOffload : public CudaTest {
 protected:
  ModelMemory offloaded() { return {gpu().memory(), *gpu().offload_memory()}; }
  /// Copies of the same model in each memory go through the same work; both must end alike.
  template <class Work>
  void expect_same(const TrainingModel& start, Work&& work) {
    TrainingModel whole = copy_to(gpu().memory(), start), parted = copy_to(offloaded(), start);
    for (TrainingModel* const model : {&whole, &parted}) {
      work(*model);
      gpu().synchronize(*model);
    }
    EXPECT_TRUE(parted.memory().offloads_sh());
    EXPECT_FALSE(whole.memory().offloads_sh());
    EXPECT_TRUE(same_bits(on_host(parted), on_host(whole)))
        << differing_arrays(on_host(parted), on_host(whole)) << parted.count() << " rows";
  }
  /// Steps by single photos, or by all of them, with the same sums each time.
  void take_steps(TrainingModel& model, const std::vector<View>& views, bool is_batch, int degree,
                  int steps = 7) {
    RenderSettings settings;
    settings.deterministic = true;
    settings.sh_degree = degree;
    std::vector<TrainingPhoto> photos;
    for (const View& view : views) photos.push_back({&view, settings});
    for (int step = 0; step < steps; ++step)
      gpu().step(
          model,
          {&photos[is_batch ? 0 : std::size_t(step) % photos.size()], is_batch ? photos.size() : 1},
          {0.2f}, update_of(is_batch ? int(photos.size()) : 1), {true});
  }
};

TEST_F(CudaOffload, StepsHaveTheBitsOfThoseOnTheGpuAlone) {
  const std::vector<View> views = shifted_views(3, 50, true);
  for (const Gaussians& gaussians : all_forms())
    for (const MomentForm form : kMomentForms)
      for (const bool is_lazy : {false, true})
        for (const bool is_batch : {false, true})
          for (const int degree : {0, 2, 3}) {
            SCOPED_TRACE(testing::Message() << word_of(form) << ", lazy " << is_lazy << ", batch "
                                            << is_batch << ", degree " << degree);
            TrainingModel start = model_of(gaussians, form);
            if (is_lazy) begin_lazy(start, 11);
            expect_same(start,
                        [&](TrainingModel& model) { take_steps(model, views, is_batch, degree); });
          }
}

TEST_F(CudaOffload, RowOperationsBetweenStepsHaveTheBitsOfThoseOnTheGpuAlone) {
  const std::vector<View> views = shifted_views(3, 50, true);
  constexpr AdaptiveRules kRules{.gradient_threshold = 1e-5f,
                                 .small_scale = 0.1f,
                                 .prune_opacity = 0.05f,
                                 .prune_scale = 1,
                                 .max_gaussians = 0};
  for (const Gaussians& gaussians : all_forms())
    for (const MomentForm form : kMomentForms)
      for (const bool is_lazy : {false, true}) {
        SCOPED_TRACE(testing::Message() << word_of(form) << ", lazy " << is_lazy);
        TrainingModel start = model_of(gaussians, form);
        if (is_lazy) begin_lazy(start, 11);
        expect_same(start, [&](TrainingModel& model) {
          // rows() waits for the steps before it, some of which may have to be repeated.
          take_steps(model, views, false, 3);
          gpu().rows().refine(model, kRules, {1, RandomStream::split_gaussians}, 600);
          EXPECT_GT(model.count(), gaussians.count());  // arrays have grown
          take_steps(model, views, false, 3);
          gpu().rows().sort_by_morton(model);
          gpu().rows().relocate(model, {0.05f, std::int64_t(model.count()) + 500}, 1, 700);
          take_steps(model, views, true, 3);
          gpu().rows().prune_share(model, PruneOrder::opacity, 0.2);
          gpu().rows().lower_opacity(model, {OpacityPolicy::reset, 0.3f, MomentClearing::all});
          take_steps(model, views, false, 3);
          gpu().rows().prune(model, 0.01f);
          gpu().rows().catch_up(model);
        });
      }
}

TEST_F(CudaOffload, LooksSeeTheSameAndChangeNothing) {
  const std::vector<View> views = shifted_views(3, 50, true);
  TrainingModel start = model_of(all_forms()[0]);
  begin_lazy(start, 11);
  TrainingModel whole = copy_to(gpu().memory(), start), parted = copy_to(offloaded(), start);
  std::vector<Gaussians> shown;
  for (TrainingModel* const model : {&whole, &parted}) {
    take_steps(*model, views, false, 3);
    gpu().synchronize(*model);
    const TrainingModel before = on_host(*model);
    {
      const CurrentSh current(*model, gpu().rows());
      shown.push_back(host_copy(model->gaussians, kMaxShDegree, false).gaussians);
    }
    EXPECT_TRUE(same_bits(on_host(*model), before));
  }
  EXPECT_TRUE(parted.memory().offloads_sh());
  EXPECT_TRUE(same_bits(shown[0], shown[1]));
}

TEST_F(CudaOffload, TheGpuHoldsExactlyTheseArraysLess) {
  for (const MomentForm form : kMomentForms) {
    const TrainingModel start = model_of(all_forms()[0], form);
    const auto usage_of = [&](const ModelMemory& memory) {
      const cuda::Usage before = cuda::usage();
      const TrainingModel model = copy_to(memory, start);
      const cuda::Usage now = cuda::usage();
      return std::pair(now.allocated_bytes - before.allocated_bytes,
                       now.mapped_host_bytes - before.mapped_host_bytes);
    };
    const auto [whole, none] = usage_of(gpu().memory());
    const auto [rest, mapped] = usage_of(offloaded());
    EXPECT_EQ(none, 0u);
    EXPECT_EQ(mapped, start.count() * 45u * unsigned(4 + moment_bytes(form)));
    EXPECT_EQ(whole - rest, mapped);
  }
  EXPECT_EQ(cuda::usage().mapped_host_bytes, 0u);
}

TEST_F(CudaOffload, ALackOfHostMemoryIsAnErrorWithARemedy) {
  Memory& memory = *gpu().offload_memory();
  try {
    memory.allocate(std::size_t(1) << 46);
    FAIL() << "64 TiB";
  } catch (const Error& error) {
    EXPECT_EQ(error.code(), ExitCode::out_of_memory);
    EXPECT_NE(std::string(error.what()).find("--max-gaussians"), std::string::npos);
  }
  Buffer<float> works(1000, memory);  // the next one
  works.fill_zero();
  for (const float zero : works.download()) EXPECT_EQ(zero, 0.0f);
}

TEST_F(CudaOffload, TheLinkIsMeasured) {
  const double gb_per_second = link_gb_per_second(gpu()).value();
  RecordProperty("gb_per_second", std::to_string(gb_per_second));
  EXPECT_GT(gb_per_second, 0.5);
  EXPECT_LT(gb_per_second, 2000);
}

// ---- runs --------------------------------------------------------------------------------------

class CudaOffloadedRun : public CudaTest {
 protected:
  /// The most bytes allocated after a step.
  class NoteUsage final : public Observer {
   public:
    void after_step(int, Trainer& trainer) override {
      on_host = std::max(on_host, cuda::usage().mapped_host_bytes);
      const TrainingModel& model = trainer.model();
      if (model.memory().offloads_sh()) {
        EXPECT_EQ(cuda::usage().mapped_host_bytes, sh_rest_bytes(model));
      }
    }
    std::size_t on_host = 0;
  };
  TrainingModel trained(const Config& config) {
    NoteUsage usage;
    Trainer trainer(scene_, config, gpu());
    trainer.add_observer(usage);
    trainer.run();
    EXPECT_EQ(usage.on_host > 0, config.train.offload == OffloadMode::sh);
    return on_host(trainer.model());
  }
  static Config deterministic(Config config) {
    config.train.deterministic = true;
    config.train.iterations = 130;
    return config;
  }
  static Config with(OffloadMode mode, Config config) {
    config.train.offload = mode;
    return config;
  }
  const Scene scene_ = scene_of_two_halves();
};

TEST_F(CudaOffloadedRun, EndsWithTheBitsOfARunOnTheGpuAlone) {
  for (Config config : {deterministic(busy_run()), deterministic(short_mcmc_run())})
    for (const LazyMode lazy : {LazyMode::on, LazyMode::off})
      for (const MomentForm moments : kMomentForms)
        for (const int batch : {1, 3}) {
          SCOPED_TRACE(testing::Message() << config.density.strategy << int(lazy) << int(moments)
                                          << ", batch " << batch);
          config.optimizer.lazy = lazy;
          config.optimizer.moments = moments;
          config.train.batch = batch;
          const TrainingModel whole = trained(with(OffloadMode::none, config));
          EXPECT_TRUE(same_bits(trained(with(OffloadMode::sh, config)), whole));
        }
}

TEST_F(CudaOffloadedRun, GoesOnInOtherMemoryWithTheSameBits) {
  const Config config = deterministic(busy_run());
  const Config there = with(OffloadMode::sh, config), here = with(OffloadMode::none, config);
  const TrainingModel whole = trained(there);
  for (const int stop : {1, 43, 97})
    for (const Config* const afterwards : {&there, &here}) {
      SCOPED_TRACE(stop);
      LastState kept;
      StopAfter stopper(stop);
      Trainer first(scene_, there, gpu());
      first.keep_checkpoints_in(kept);
      first.add_observer(stopper);
      first.run();
      Trainer second(scene_, *afterwards, gpu(), *kept.newest());
      second.run();
      EXPECT_EQ(second.model().memory().offloads_sh(), afterwards == &there);
      EXPECT_TRUE(same_bits(on_host(second.model()), whole));
    }
}

// A GPU has more than this small run takes.
TEST_F(CudaOffloadedRun, IsNotTakenByItselfWhereTheRunFits) {
  Trainer trainer(scene_, deterministic(busy_run()), gpu());
  EXPECT_FALSE(trainer.model().memory().offloads_sh());
}

}  // namespace
}  // namespace gs
