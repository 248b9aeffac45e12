// SPDX-License-Identifier: Apache-2.0
// Runs of the trainer on a scene in memory: a fixture, memory that runs out when it is told to, stops
// after a step, and the states to go on from.
#pragma once

#include "gs_core/memory.h"
#include "gs_eval/metrics.h"
#include "gs_train/loop/trainer.h"
#include "gs_train/loop/view_sampler.h"
#include "gs_train/stages/scalar_stages.h"
#include "tests/support/models.h"
#include "tests/support/small_scene.h"

namespace gs {

/// While it lives, allocations of any Memory are counted, and the one with number `failure` fails, or
/// all from that one on; 0: none.
class FailingMemory {
 public:
  explicit FailingMemory(int failure, bool for_good = false)
      : failure_(failure), for_good_(for_good) {
    alive_ = this;
    set_allocation_hook(fail);
  }
  ~FailingMemory() {
    set_allocation_hook(nullptr);
    alive_ = nullptr;
  }
  int allocations() const { return allocations_; }
  bool has_failed() const { return allocations_ >= failure_; }
  /// What `action` makes of memory that never runs out.
  template <class Action>
  static auto spared(Action&& action) {
    set_allocation_hook(nullptr);
    auto made = action();
    if (alive_) set_allocation_hook(fail);
    return made;
  }

 private:
  static void fail(std::size_t) {
    const int number = ++alive_->allocations_, first = alive_->failure_;
    if (first > 0 && (number == first || (alive_->for_good_ && number > first)))
      throw Error("out of memory, says the test", ExitCode::out_of_memory);
  }
  inline static FailingMemory* alive_ = nullptr;
  int failure_, allocations_ = 0;
  bool for_good_;
};

/// Checkpoints in host memory that never runs out.
class KeptStates final : public CheckpointStore {
 public:
  bool save(const RunProgress& progress, const TrainingModel& model) override {
    states.push_back(FailingMemory::spared([&] { return copy(progress, model); }));
    return true;
  }
  std::optional<TrainingState> newest() override {
    if (states.empty()) return std::nullopt;
    return copy(states.back());
  }
  static TrainingState copy(const TrainingState& state) {
    return copy(state.progress, state.model);
  }
  static TrainingState copy(const RunProgress& progress, const TrainingModel& model) {
    return {progress, copy_to(host_memory(), model)};
  }
  std::vector<TrainingState> states;
};

/// Calls a function after each step, and notes where the run went back to.
class After : public Observer {
 public:
  using Function = std::function<void(int step, Trainer& trainer)>;
  explicit After(Function f) : f_(std::move(f)) {}
  void after_step(int step, Trainer& trainer) override { f_(step, trainer); }
  void after_rollback(int step, Trainer&) override { rollbacks.push_back(step); }
  std::vector<int> rollbacks;

 private:
  Function f_;
};
/// The beginning of a run on so many views from these Gaussians.
inline TrainingState state_of(const Gaussians& gaussians, std::size_t view_count,
                              const Config& config) {
  TrainingState state;
  state.model = model_of(gaussians, config.optimizer.moments);
  state.progress.strikes.assign(view_count, 0);
  ViewSampler views(view_count, config.train.seed);
  views.view_of(1);
  state.progress.view_order = {views.order().begin(), views.order().end()};
  return state;
}

/// Asks a run to stop after a step.
inline After stop_after(int stop) {
  return After([stop](int step, Trainer& trainer) {
    if (step == stop) trainer.stop();
  });
}

/// Of these views, as the trainer renders them.   dB
inline double psnr_of(Backend& backend, Trainer& trainer, const std::vector<View>& views) {
  return evaluate(backend.renderer(), trainer.model().gaussians.span(), views,
                  trainer.evaluation_settings())
      .psnr;
}

/// The model, in host memory, of a whole run.
inline TrainingModel model_of_run(const Scene& scene, const Config& config, Backend& backend) {
  Trainer trainer(scene, config, backend);
  trainer.run();
  return copy_to(host_memory(), trainer.model());
}

/// The state of a run that is stopped after a step, which ends with the batch that follows.
inline TrainingState stopped_after(int stop, const Scene& scene, const Config& config,
                                   Backend& backend, std::optional<TrainingState> from = {}) {
  KeptStates kept;
  After stopper = stop_after(stop);
  std::optional<Trainer> trainer;
  if (from)
    trainer.emplace(scene, config, backend, std::move(*from));
  else
    trainer.emplace(scene, config, backend);
  trainer->keep_checkpoints_in(kept);
  trainer->add_observer(stopper);
  trainer->run();
  const int batch = config.train.batch;
  EXPECT_EQ(trainer->step(),
            std::min((stop + batch - 1) / batch * batch + batch, config.train.iterations));
  return *kept.newest();
}
/// The model, in host memory, of a run that goes on from such a state, with the settings
/// `afterwards`.
inline TrainingModel resumed_after(int stop, const Scene& scene, const Config& config,
                                   Backend& backend, const Config& afterwards) {
  Trainer trainer(scene, afterwards, backend, stopped_after(stop, scene, config, backend));
  trainer.run();
  return copy_to(host_memory(), trainer.model());
}
/// The same with the settings that it began with.
inline TrainingModel resumed_after(int stop, const Scene& scene, const Config& config,
                                   Backend& backend) {
  return resumed_after(stop, scene, config, backend, config);
}

/// Tests that train on one scene with the scalar backend.
class SceneRun : public ::testing::Test {
 protected:
  explicit SceneRun(Scene scene) : scene_(std::move(scene)) {}
  TrainingModel trained(const Config& config) { return model_of_run(scene_, config, *backend_); }
  /// Of the training views, after a run that must leave finite numbers.   dB
  double psnr_after(const Config& config) {
    Trainer trainer(scene_, config, *backend_);
    trainer.run();
    EXPECT_EQ(backend_->rows().count_not_finite(trainer.model()), 0u);
    return psnr_of(*backend_, trainer, scene_.train_views);
  }
  void expect_same_bits_on_any_threads(const Config& config) {
    const auto train = [&] { return trained(config); };
    EXPECT_TRUE(same_bits(with_threads(1, train), with_threads(3, train)))
        << config.density.strategy;
  }
  /// A run that is stopped after a step, and goes on from its checkpoint, ends in the bits of one
  /// that was never stopped.
  void expect_goes_on_after(std::initializer_list<int> stops, const Config& config) {
    const TrainingModel expected = trained(config);
    for (const int stop : stops) {
      EXPECT_TRUE(same_bits(resumed_after(stop, scene_, config, *backend_), expected))
          << config.density.strategy << " " << stop;
    }
  }

  Scene scene_;
  const std::unique_ptr<Backend> backend_ = make_scalar_backend();
};

}  // namespace gs
