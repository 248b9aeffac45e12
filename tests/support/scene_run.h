// SPDX-License-Identifier: Apache-2.0
// Runs of the trainer on a scene in memory: a fixture, a stop after a step, and the state to go on
// from.
#pragma once

#include <gtest/gtest.h>

#include <initializer_list>
#include <memory>
#include <optional>
#include <utility>

#include "gs_eval/metrics.h"
#include "gs_train/loop/trainer.h"
#include "gs_train/stages/scalar_stages.h"
#include "tests/support/models.h"

namespace gs {

/// Keeps the last checkpoint in memory.
class LastState final : public CheckpointStore {
 public:
  bool save(const RunProgress& progress, const TrainingModel& model) override {
    state = {progress, copy_to(host_memory(), model)};
    return true;
  }
  std::optional<TrainingState> newest() override {
    return TrainingState{state.progress, copy_to(host_memory(), state.model)};
  }
  TrainingState state;
};

/// Asks a run to stop after a step.
class StopAfter final : public Observer {
 public:
  explicit StopAfter(int step) : step_(step) {}
  void after_step(int step, Trainer& trainer) override {
    if (step == step_) trainer.stop();
  }

 private:
  int step_;
};

/// The model, in host memory, of a whole run.
inline TrainingModel model_of_run(const Scene& scene, const Config& config, Backend& backend) {
  Trainer trainer(scene, config, backend);
  trainer.run();
  return copy_to(host_memory(), trainer.model());
}

/// The model, in host memory, of a run that is stopped after a step and goes on from its
/// checkpoint, with the settings `afterwards`.
inline TrainingModel resumed_after(int stop, const Scene& scene, const Config& config,
                                   Backend& backend, const Config& afterwards) {
  LastState kept;
  StopAfter stopper(stop);
  Trainer first(scene, config, backend);
  first.keep_checkpoints_in(kept);
  first.add_observer(stopper);
  first.run();
  Trainer second(scene, afterwards, backend, *kept.newest());
  second.run();
  return copy_to(host_memory(), second.model());
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
  /// Of the training views, after a run that must leave finite numbers.
  double psnr_after(const Config& config) {
    Trainer trainer(scene_, config, *backend_);
    trainer.run();
    EXPECT_EQ(backend_->rows().count_not_finite(trainer.model()), 0u);
    return evaluate(backend_->renderer(), trainer.model().gaussians.span(), scene_.train_views,
                    trainer.evaluation_settings())
        .psnr;
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

  const Scene scene_;
  const std::unique_ptr<Backend> backend_ = make_scalar_backend();
};

}  // namespace gs
