// SPDX-License-Identifier: Apache-2.0
// The training loop.
#pragma once

#include <atomic>
#include <functional>
#include <optional>
#include <string>
#include <vector>

#include "gs_core/config/config.h"
#include "gs_core/scene.h"
#include "gs_render/render_settings.h"
#include "gs_train/backend.h"
#include "gs_train/density/floaters.h"
#include "gs_train/loop/checkpoint.h"
#include "gs_train/loop/run_recovery.h"
#include "gs_train/loop/training_run.h"
#include "gs_train/loop/view_sampler.h"
#include "gs_train/loss.h"
#include "gs_train/schedule.h"

namespace gs {

class Trainer;

/// Watches a run: logs, evaluates, saves. An observer is never part of a step.
class Observer {
 public:
  virtual ~Observer() = default;
  /// Called once for each step, in order. In a run with batches the trainer may be up to
  /// train.batch - 1 steps further, because a batch is taken as a whole.
  virtual void after_step(int step, Trainer& trainer) = 0;
  /// The run went back to the state after `step`. The steps after it come again.
  virtual void after_rollback([[maybe_unused]] int step, Trainer&) {}
  virtual void after_run(Trainer&) {}
};

/// Trains Gaussians on a scene: construct it, add observers, call run() once. The scene, the
/// backend, the observers and the checkpoints outlive it.
///
/// With checkpoints a run survives a kill, a breakdown of the model, and a lack of memory where
/// releasing caches and an end of growth help: docs/reference/checkpoints.md.
class Trainer {
 public:
  /// Initializes the Gaussians from the scene's points. Throws Error where there is nothing to
  /// train, UsageError where the backend lacks what the config asks for, and where the config names
  /// a model to start from: state_from_model() in gs_app/session/start_model.h makes a state of it.
  Trainer(const Scene& scene, const Config& config, Backend& backend);
  /// Goes on from a state of a run on the same scene. Throws Error where it is of another scene or
  /// config.
  Trainer(const Scene& scene, const Config& config, Backend& backend, TrainingState from);

  void add_observer(Observer& observer) { observers_.push_back(&observer); }
  void keep_checkpoints_in(CheckpointStore& checkpoints) {
    recovery_.keep_checkpoints_in(checkpoints);
  }

  /// The whole run, or the rest of it, with final prune and Morton order. Throws Error (out of
  /// memory) where memory is short even after all caches were released; the checkpoints have the
  /// state then.
  void run();
  /// The parts of run(), for programs that take the steps themselves: begin(), take() while steps
  /// are left, and end(). What density control or a loss throws comes out of take(), which can be
  /// called again.
  void begin();
  /// Takes the next step, or batch. Returns whether steps are left.
  bool take();
  void end();
  /// Density control of the program itself, in place of the method that density.strategy names.
  void control_density_by(std::unique_ptr<DensityControl> density);
  /// Asks run() to end as if the next step, or batch, were the last. Safe to call from a signal handler.
  void stop() { stop_requested_ = true; }
  bool stopped_early() const { return stop_requested_; }
  /// Runs f() with a second attempt where memory runs out, as run() does with its own work. For
  /// saving and evaluating the result; f() must be repeatable. `what` completes "out of memory in
  /// ...". Throws Error (out of memory).
  void guarded(const std::string& what, const std::function<void()>& f) {
    recovery_.guarded(what, f);
  }

  /// Steps done.
  int step() const { return run_.step; }
  /// The model after all steps so far. Waits for the device.
  const TrainingModel& model() { return run_.synchronized_model(); }
  /// The same, for changes between two steps such as density control makes.
  TrainingModel& model_to_change() { return run_.synchronized_model(); }
  /// What a checkpoint has besides the model, before end(). Waits for the device.
  RunProgress progress() { return recovery_.progress(); }
  /// The number of Gaussians. Does not wait.
  std::size_t gaussian_count() const { return run_.model.count(); }
  /// How many were removed at the end because photos look through them (floaters.h).
  std::size_t removed_floaters() const { return removed_floaters_; }
  const RenderSettings& settings() const { return run_.settings; }
  /// The settings for looking at the model: as trained, on the fixed background (black for
  /// "random").
  RenderSettings evaluation_settings() const;
  const Schedule& schedule() const { return run_.schedule; }
  const Scene& scene() const { return run_.scene; }
  /// The config as it was given, with numbers in place of what follows from the scene
  /// (gs_core/config/scene_settings.h) and of density.max_gaussians = auto.
  const Config& config() const { return run_.config; }
  Backend& backend() { return run_.backend; }
  /// The loss of the last step. Waits for the device.
  double loss();
  /// Seconds spent in steps and density control so far. Observers are not counted.
  double train_seconds() const { return run_.train_seconds; }

 private:
  Trainer(const Scene& scene, const Config& config, Backend& backend, TrainingModel model);
  int end_of_batch() const;
  void advance(int last_step);
  void take_batch(int last_step);
  TrainingPhoto photo_of(std::size_t row, int step);
  void prepare_surface_terms();
  const View* neighbor_of(std::size_t row, int step) const;  // null: no photo is compared with one
  RenderSettings settings_of(int step);
  void control_density(int step);
  void maintain(int step);
  void finish_model();
  void sort_by_morton();
  void measure_filter();
  void remove_floaters();
  void prefetch_decode(int first_step, int last_step);
  const View& view_of(ViewSampler& views, int step);
  void notify(const std::function<void(Observer&)>& f);

  TrainingRun run_;
  RunRecovery recovery_;
  ViewSampler views_, views_ahead_;
  std::vector<TrainingPhoto> batch_;
  // (views)  neighbor_views(), with a loss of photos; else empty
  std::vector<std::vector<std::uint32_t>> neighbors_;
  std::vector<Observer*> observers_;
  std::size_t removed_floaters_ = 0;
  std::atomic<bool> stop_requested_ = false;  // a signal may come to any thread
};

/// The model as it is now, as files carry it: without Gaussians that cannot be seen. Waits for the
/// device.
/// A 3D filter is part of its scales and opacities (bake_filter.h).
GaussianModel trained_model(Trainer& trainer);
/// The model with the 3D filter beside scales and opacities, for training on. The run has
/// model.filter_3d.
GaussianModel raw_model(Trainer& trainer);
/// trained_model() in two steps: the copy, which waits for the device, and the part of it that can
/// be seen.
GaussianModel copied_model(Trainer& trainer);
GaussianModel visible_part(const GaussianModel& model);

}  // namespace gs
