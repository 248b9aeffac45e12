// SPDX-License-Identifier: Apache-2.0
// The training loop.
#pragma once

#include <functional>
#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "gs_core/config/config.h"
#include "gs_core/scene.h"
#include "gs_train/backend.h"
#include "gs_train/checkpoint.h"
#include "gs_train/checkpoint_timer.h"
#include "gs_train/density_control.h"
#include "gs_train/floaters.h"
#include "gs_train/run_guard.h"
#include "gs_train/schedule.h"
#include "gs_train/view_sampler.h"

namespace gs {

class Trainer;

/// Watches a run: logs, evaluates, saves. Never part of a step.
class Observer {
 public:
  virtual ~Observer() = default;
  virtual void after_step(int step, Trainer& trainer) = 0;
  /// The run went back to the state after `step`: what was seen of later steps will be seen again.
  virtual void after_rollback([[maybe_unused]] int step, Trainer&) {}
  virtual void after_run(Trainer&) {}
};

/// Trains Gaussians on a scene. Make it, add observers, run() once. The scene, the backend, the
/// observers and the checkpoints outlive it.
///
/// With checkpoints a run outlives a kill, a breakdown (RunGuard) and, where giving back caches and an end of growth
/// help, a lack of memory: docs/checkpoints.md.
class Trainer {
 public:
  /// Initializes the Gaussians from the scene's points. Throws Error where there is nothing to train.
  Trainer(const Scene& scene, const Config& config, Backend& backend);
  /// Goes on from a state of a run on the same scene. Throws Error where it cannot be one of this scene and config.
  Trainer(const Scene& scene, const Config& config, Backend& backend, TrainingState from);

  void add_observer(Observer& observer) { observers_.push_back(&observer); }
  void keep_checkpoints_in(CheckpointStore& checkpoints) { checkpoints_ = &checkpoints; }

  /// The whole run, or what is left of it, with final prune and Morton order. Throws Error (out of memory) where that is
  /// short even after all that can be given back; the state is in the checkpoints then.
  void run();
  /// Asks run() to end as if the next step were the last; safe to call from a signal handler.
  void stop() { stop_requested_ = true; }
  bool stopped_early() const { return stop_requested_; }

  /// Steps done.
  int step() const { return step_; }
  /// The model after all steps so far; waits for the device.
  const TrainingModel& model();
  /// Calls f with it as the run would leave it if it ended here: what hangs before cameras (floaters.h) and what is too faint
  /// cannot be seen. Waits for the device.
  void look_at_result(const std::function<void(const Gaussians&)>& f);
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
  Trainer(const Scene& scene, const Config& config, Backend& backend, TrainingModel model);
  // Runs f() as a part of training, not of what observers do.
  template <class F>
  auto timed(F&& f);
  void begin();
  void take_step(int step);
  void one_step(int step);
  void control_density(int step);
  void maintain(int step);
  void expect_views_from(int first, int last);
  void finish();
  const View& view_of(ViewSampler& views, int step);
  Vec3f random_background(int step) const;
  void notify(const std::function<void(Observer&)>& f);
  bool wants_checkpoint(bool is_last, bool is_stopped) const;

  // trainer_recovery.cpp: what happens where not all goes well.
  void look_at_model();
  bool is_sound();
  void keep_checkpoint();
  bool save_state();
  void roll_back();
  void restore(TrainingState from);
  RunProgress progress();
  bool with_room(const char* what, const std::function<void()>& f);
  void if_there_is_room(const char* what, const std::function<void()>& f);
  void make_room(const char* what);

  const ClearSpace& clear_space();

  const Scene& scene_;
  Config config_;
  Backend& backend_;
  Schedule schedule_;
  RenderSettings settings_;
  ViewSampler views_, views_ahead_;
  TrainingModel model_;
  std::unique_ptr<DensityControl> density_;
  std::vector<Observer*> observers_;
  CheckpointStore* checkpoints_ = nullptr;
  CheckpointTimer checkpoint_timer_;
  RunGuard guard_;
  std::string breakdown_;  // why the model is of no use any more; empty: it is
  bool blames_view_ = true;
  std::string memory_trouble_;  // the last time that memory ran out
  int step_ = 0;  // steps done
  int first_step_ = 1;  // of this process
  double restored_loss_ = 0;
  double train_seconds_ = 0;
  bool is_finishing_ = false;
  std::optional<ClearSpace> clear_space_;  // found when the result is first looked at
  volatile bool stop_requested_ = false;
};

/// The model as it is now, as files carry it: what cannot be seen is left out. Waits for the device.
GaussianModel trained_model(Trainer& trainer);
/// The same in two steps: the copy, which waits for the device, and what of it can be seen.
GaussianModel copied_model(Trainer& trainer);
GaussianModel visible_part(const GaussianModel& model);

/// Render settings as the config states them, at the model's full SH degree.
RenderSettings render_settings(const Config& config);

}  // namespace gs
