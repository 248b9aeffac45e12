// SPDX-License-Identifier: Apache-2.0
// The training loop.
#pragma once

#include <memory>
#include <vector>

#include "gs_core/config.h"
#include "gs_core/scene.h"
#include "gs_train/backend.h"
#include "gs_train/density_control.h"
#include "gs_train/schedule.h"
#include "gs_train/view_sampler.h"

namespace gs {

class Trainer;

/// Watches a run: logs, evaluates, saves. Never part of a step.
class Observer {
 public:
  virtual ~Observer() = default;
  virtual void after_step(int step, Trainer& trainer) = 0;
  virtual void after_run(Trainer&) {}
};

/// Trains Gaussians on a scene. Make it, add observers, run() once. The scene, the backend and the
/// observers outlive it.
class Trainer {
 public:
  /// Initialises the Gaussians from the scene's points. Throws Error where there is nothing to train.
  Trainer(const Scene& scene, const Config& config, Backend& backend);

  void add_observer(Observer& observer) { observers_.push_back(&observer); }

  /// The whole run, with final prune and Morton order.
  void run();
  /// Asks run() to end as if the next step were the last; safe to call from a signal handler.
  void stop() { stop_requested_ = true; }
  bool stopped_early() const { return stop_requested_; }

  /// The model after all steps so far; waits for the device.
  const TrainingModel& model();
  /// Its number of Gaussians; does not wait.
  std::size_t gaussian_count() const { return model_.count(); }
  const RenderSettings& settings() const { return settings_; }
  /// The settings for looking at the model: as trained, on the fixed background (black for "random").
  RenderSettings evaluation_settings() const;
  const Schedule& schedule() const { return schedule_; }
  const Scene& scene() const { return scene_; }
  /// As given, but for density.max_gaussians: where it was to be found out, it is the number found.
  const Config& config() const { return config_; }
  Backend& backend() { return backend_; }
  /// The loss of the last step; waits for the device.
  double loss();
  /// Seconds spent in steps and density control so far; observers are not counted.
  double train_seconds() const { return train_seconds_; }

 private:
  // Runs f() as a part of training, not of what observers do.
  template <class F>
  auto timed(F&& f);
  void one_step(int step);
  void expect_view_of(int step);
  void finish();
  Vec3f random_background(int step) const;

  const Scene& scene_;
  Config config_;
  Backend& backend_;
  Schedule schedule_;
  RenderSettings settings_;
  ViewSampler views_, views_ahead_;
  TrainingModel model_;
  std::unique_ptr<DensityControl> density_;
  std::vector<Observer*> observers_;
  int step_ = 0;  // steps done
  double train_seconds_ = 0;
  volatile bool stop_requested_ = false;
};

/// Render settings as the config states them, at the model's full SH degree.
RenderSettings render_settings(const Config& config);

}  // namespace gs
