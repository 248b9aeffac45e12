// SPDX-License-Identifier: Apache-2.0
// How the trainer handles trouble: stops, breakdowns, and a lack of memory at every single
// allocation.
#include "tests/support/scene_run.h"

namespace gs {
namespace {

/// 120 steps with refinements after 20, 40, ..., and a checkpoint after every tenth step.
Config eventful_run() {
  Config config = growing_run(120);
  config.train.checkpoint_every = 10;
  config.render.background = Background::random;
  return config;
}

class Recovery : public SceneRun {
 protected:
  Recovery() : SceneRun(small_scene()) {}
};

// ---- stop and resume ---------------------------------------------------------------------------
TEST_F(Recovery, ARunThatIsStoppedAnywhereAndResumedEndsWithTheSameBits) {
  Config config = eventful_run();
  expect_goes_on_after({1, 19, 20, 63, 118}, config);
  config.train.batch = 7;
  expect_goes_on_after({1, 7, 20, 63}, config);
}

TEST_F(Recovery, EveryCheckpointLeadsToTheSameBits) {
  const Config config = eventful_run();
  KeptStates kept;
  Trainer first(scene_, config, *backend_);
  first.keep_checkpoints_in(kept);
  first.run();
  ASSERT_EQ(kept.states.size(), 12u);
  // before the final prune: what an extension starts from
  EXPECT_EQ(kept.states.back().progress.step, 120);
  for (const TrainingState& state : kept.states) {
    Trainer second(scene_, config, *backend_, KeptStates::copy(state));
    second.run();
    EXPECT_TRUE(same_bits(second.model(), first.model())) << state.progress.step;
    EXPECT_EQ(second.loss(), first.loss());
  }
}

TEST_F(Recovery, ExtraStepsGoOnAfterTheScheduleWithoutChangingIt) {
  Config config = eventful_run();
  KeptStates kept;
  Trainer shorter(scene_, config, *backend_);
  shorter.keep_checkpoints_in(kept);
  shorter.run();
  config.train.extra_steps = 30;
  const TrainingModel longer = trained(config);
  Trainer extended(scene_, config, *backend_, *kept.newest());
  extended.run();
  EXPECT_EQ(extended.step(), 150);
  EXPECT_TRUE(same_bits(extended.model(), longer));
}

TEST_F(Recovery, ACapThatWasFoundOutIsNotFoundOutAgain) {
  Config config = eventful_run();
  config.density.max_gaussians = kAutoCount;
  KeptStates kept;
  const auto backend = make_scalar_backend();
  Trainer first(scene_, config, *backend);
  first.keep_checkpoints_in(kept);
  first.run();
  ASSERT_FALSE(kept.states.empty());
  TrainingState state = KeptStates::copy(kept.states.front());
  EXPECT_EQ(state.progress.growth_cap, first.config().density.max_gaussians);
  state.progress.growth_cap = 57;  // as if there had been less memory
  Trainer second(scene_, config, *backend, std::move(state));
  EXPECT_EQ(second.config().density.max_gaussians, 57);
  second.keep_checkpoints_in(kept);
  second.run();
  EXPECT_LE(second.model().count(), std::max<std::size_t>(57, kept.states.front().model.count()));
  EXPECT_EQ(kept.states.back().progress.growth_cap, 57);
}

TEST_F(Recovery, AStateOfAnotherSceneOrSeedIsRefused) {
  Config config = eventful_run();
  config.train.iterations = 10;
  KeptStates kept;
  Trainer trainer(scene_, config, *backend_);
  trainer.keep_checkpoints_in(kept);
  trainer.run();
  config.train.seed += 1;
  EXPECT_THROW(Trainer(scene_, config, *backend_, *kept.newest()), Error);
  config.train.seed -= 1;
  scene_.train_views.pop_back();
  EXPECT_THROW(Trainer(scene_, config, *backend_, *kept.newest()), Error);
}

// ---- breakdowns --------------------------------------------------------------------------------

TEST_F(Recovery, ParametersThatBreakOnceAreMendedByTheLastCheckpointOrTheStart) {
  for (const bool has_checkpoints : {true, false}) {
    Config config = eventful_run();
    if (!has_checkpoints) config.train.checkpoint_every = -1;
    bool is_done = false;
    After poison([&](int step, Trainer& trainer) {
      if (step != 55 || std::exchange(is_done, true)) return;
      for (Vec3f& mean : trainer.model().gaussians.mean) mean.y = kNan;
    });
    KeptStates kept;
    Trainer trainer(scene_, config, *backend_);
    if (has_checkpoints) trainer.keep_checkpoints_in(kept);
    trainer.add_observer(poison);
    trainer.run();
    EXPECT_EQ(poison.rollbacks, std::vector<int>{has_checkpoints ? 50 : 0});
    EXPECT_TRUE(same_bits(trainer.model(), trained(config)));
  }
}

TEST_F(Recovery, AViewThatBreaksTheModelIsSkippedAfterTwoStrikes) {
  scene_.train_views[3].exposure = Vec3f(kNan);
  KeptStates kept;
  After watch([](int step, Trainer& trainer) {
    if (step % 5 == 0) trainer.loss();  // the log reads the loss like this
  });
  Trainer trainer(scene_, eventful_run(), *backend_);
  trainer.keep_checkpoints_in(kept);
  trainer.add_observer(watch);
  trainer.run();
  EXPECT_EQ(kept.newest()->progress.strikes[3], kMostStrikes);
  EXPECT_EQ(watch.rollbacks.size(), 3u);  // the discovery, and two strikes
  EXPECT_EQ(backend_->rows().count_not_finite(trainer.model()), 0u);
  EXPECT_GT(trainer.gaussian_count(), 20u);
  for (const TrainingState& state : kept.states)
    EXPECT_EQ(backend_->rows().count_not_finite(state.model), 0u) << state.progress.step;
}

TEST_F(Recovery, AModelThatCollapsesOnceIsMendedAndTwiceEndsTheRun) {
  const Config config = eventful_run();
  const TrainingModel expected = trained(config);
  for (const bool again : {false, true}) {
    int collapses = 0;
    After drain([&](int step, Trainer& trainer) {
      if (step == 59 && (again || collapses++ == 0))
        for (float& logit : trainer.model().gaussians.logit_opacity) logit = -20;
    });
    KeptStates kept;
    Trainer trainer(scene_, config, *backend_);
    trainer.keep_checkpoints_in(kept);
    trainer.add_observer(drain);
    if (again) {
      EXPECT_THROW(trainer.run(), Error);
    } else {
      trainer.run();
      EXPECT_TRUE(same_bits(trainer.model(), expected));
    }
  }
}

TEST_F(Recovery, ASceneOnWhichEveryViewBreaksIsRefused) {
  for (View& view : scene_.train_views) view.exposure = Vec3f(kNan);
  After watch([](int, Trainer& trainer) { trainer.loss(); });
  Trainer trainer(scene_, eventful_run(), *backend_);
  trainer.add_observer(watch);
  EXPECT_THROW(trainer.run(), Error);
}

// ---- a lack of memory --------------------------------------------------------------------------

/// A few steps in which everything happens.
Config brief_run() {
  Config config = eventful_run();
  config.train.iterations = 12;
  config.train.checkpoint_every = 5;
  config.density.from_step = 3;
  config.density.every = 3;
  return config;
}

// While the run finishes, the state before that is kept: see the next test.
TEST_F(Recovery, AFailureOfAnySingleAllocationIsSurvived) {
  for (const int batch : {1, 5}) {
    Config config = brief_run();
    config.train.batch = batch;
    int failures = 0, while_finishing = 0;
    for (int k = 1;; ++k, ++failures) {
      const auto backend = make_scalar_backend();
      KeptStates kept;
      Trainer trainer(scene_, config, *backend);
      trainer.keep_checkpoints_in(kept);
      FailingMemory memory(k);
      ASSERT_NO_THROW(trainer.run()) << "allocation " << k;
      if (!memory.has_failed()) break;
      EXPECT_EQ(trainer.step(), 12) << "allocation " << k;
      ASSERT_FALSE(kept.states.empty());
      while_finishing += kept.states.back().progress.growth_cap == 0;
      EXPECT_EQ(backend->rows().count_not_finite(trainer.model()), 0u);
    }
    EXPECT_GT(failures, 50);
    EXPECT_LT(while_finishing, 10);
  }
}

/// Keeps states; after that of the last step is kept, memory runs out.
class ThenNoMemory final : public CheckpointStore {
 public:
  explicit ThenNoMemory(Backend& backend) : backend_(backend) {}
  bool save(const RunProgress& progress, const TrainingModel& model) override {
    kept.save(progress, model);
    if (progress.step < 12) return true;
    backend_.release_caches();
    starving = std::make_unique<FailingMemory>(1, true);
    return true;
  }
  std::optional<TrainingState> newest() override { return kept.newest(); }
  KeptStates kept;
  std::unique_ptr<FailingMemory> starving;

 private:
  Backend& backend_;
};

// The final prune and Morton order turn the model into a result, from which a run cannot go on.
TEST_F(Recovery, WhereMemoryRunsOutWhileTheRunFinishesTheStateBeforeIsKept) {
  const auto backend = make_scalar_backend();
  ThenNoMemory store(*backend);
  Trainer trainer(scene_, brief_run(), *backend);
  trainer.keep_checkpoints_in(store);
  ASSERT_NO_THROW(trainer.run());
  EXPECT_GT(store.starving->allocations(), 0);  // that failed
  store.starving.reset();
  EXPECT_EQ(std::count_if(store.kept.states.begin(), store.kept.states.end(),
                          [](const TrainingState& state) { return state.progress.step == 12; }),
            1);
  EXPECT_EQ(store.kept.states.back().progress.growth_cap, 0);
  EXPECT_EQ(trainer.step(), 12);
}

// The result is saved and evaluated after the last step, when no step frees memory any more.
TEST_F(Recovery, SavingTheResultSurvivesTheFailureOfAnySingleAllocation) {
  int failures = 0;
  for (int k = 1;; ++k, ++failures) {
    const auto backend = make_scalar_backend();
    Trainer trainer(scene_, brief_run(), *backend);
    trainer.run();
    const Gaussians expected = copy_of(trainer.model().gaussians);
    FailingMemory memory(k);
    GaussianModel saved;
    ASSERT_NO_THROW(trainer.guarded("saving", [&] { saved = trained_model(trainer); }));
    if (!memory.has_failed()) break;
    EXPECT_TRUE(same_bits(saved.gaussians, expected)) << "allocation " << k;
  }
  EXPECT_GT(failures, 3);
}

TEST_F(Recovery, AResultThatCannotBeSavedForLackOfMemoryIsStillInTheCheckpoint) {
  KeptStates kept;
  Trainer trainer(scene_, brief_run(), *backend_);
  trainer.keep_checkpoints_in(kept);
  trainer.run();
  FailingMemory memory(1, true);
  const auto save = [&] { trainer.guarded("saving the model", [&] { trained_model(trainer); }); };
  EXPECT_THAT(save, FailsWith(ExitCode::out_of_memory));
  EXPECT_THAT(save, ThrowsMessage<Error>(HasSubstr("saving the model")));
  EXPECT_EQ(kept.states.back().progress.step, 12);
}

// Every checkpoint is a state from which a run with enough memory goes on.
TEST_F(Recovery, WhereMemoryIsGoneForGoodThereIsACheckpoint) {
  int failures = 0;
  for (int k = 1;; k += 3, ++failures) {
    const auto backend = make_scalar_backend();
    KeptStates kept;
    Trainer trainer(scene_, brief_run(), *backend);
    trainer.keep_checkpoints_in(kept);
    {
      FailingMemory memory(k, true);
      try {
        trainer.run();
        if (!memory.has_failed()) break;
      } catch (const Error& error) {
        EXPECT_EQ(error.code(), ExitCode::out_of_memory) << error.what();
      }
    }
    ASSERT_FALSE(kept.states.empty()) << "allocation " << k;
    Trainer second(scene_, brief_run(), *backend, *kept.newest());
    second.run();
    EXPECT_EQ(second.step(), 12);
  }
  EXPECT_GT(failures, 20);
}

TEST_F(Recovery, RowOperationsChangeNothingWhereMemoryRunsOut) {
  Trainer trainer(scene_, eventful_run(), *backend_);
  trainer.run();
  const GrowthRules rules{{1e-6f, 0.05f, 0.05f, std::numeric_limits<float>::infinity(), 0}};
  const std::function<void(TrainingModel&)> operations[] = {
      [&](TrainingModel& model) { backend_->rows().grow(model, rules, 1, 5); },
      [&](TrainingModel& model) { backend_->rows().prune(model, 0.3f); },
      [&](TrainingModel& model) { backend_->rows().sort_by_morton(model); }};
  for (const auto& operation : operations)
    for (int k = 1;; ++k) {
      TrainingModel model = copy_to(host_memory(), trainer.model());
      for (std::size_t i = 0; i < model.count(); ++i) model.statistics.gradient_norm[i] = 1;
      const TrainingModel before = copy_to(host_memory(), model);
      FailingMemory memory(k);
      try {
        operation(model);
      } catch (const Error&) {
        EXPECT_TRUE(same_bits(model, before)) << k;
        EXPECT_TRUE(same_bits(model.statistics.visits, before.statistics.visits));
      }
      if (!memory.has_failed()) break;
    }
}

}  // namespace
}  // namespace gs
