// SPDX-License-Identifier: Apache-2.0
// How a run reacts when something goes wrong. docs/reference/checkpoints.md describes all of it.
#pragma once

#include <functional>
#include <string>

#include "gs_train/loop/checkpoint.h"
#include "gs_train/loop/checkpoint_timer.h"
#include "gs_train/loop/run_guard.h"
#include "gs_train/loop/training_run.h"

namespace gs {

/// Keeps a run alive. Two verbs surround the work of the training loop:
///
///   guarded()                   runs a piece of work. Where memory runs out, it releases memory and
///                               runs the work again.
///   checkpoint_or_roll_back()   ends a step. It keeps a checkpoint when one is due. Where the model
///                               broke down, for example because the loss is not a number, it goes
///                               back to the last checkpoint.
///
/// The run outlives it.
class RunRecovery {
 public:
  explicit RunRecovery(TrainingRun& run);
  /// Where checkpoints go; without it there are none. The store outlives this.
  void keep_checkpoints_in(CheckpointStore& store) { store_ = &store; }
  /// Makes the run what a checkpoint says. Throws Error where that is of another scene or seed.
  void resume(TrainingState from);

  /// Runs f(), which changes nothing where memory runs out. Then keeps a checkpoint, releases
  /// caches, and runs f() once more. Throws Error (out of memory) where that is not enough. `what`
  /// completes "out of memory in ...".
  void guarded(const std::string& what, const std::function<void()>& f);
  /// Runs work that training can do without: it is skipped with a warning instead.
  void guarded_or_skipped(const std::string& what, const std::function<void()>& f);

  /// False from the moment when a breakdown was seen until the run went back.
  bool is_sound() const { return breakdown_.empty(); }
  /// Whether a breakdown is expected in a step (RunGuard).
  bool is_watching(int step) const { return guard_.is_watching(step); }
  /// Looks at the loss and the parameters after a step in which a breakdown is expected (RunGuard).
  void check_watched_step();
  void check_loss(double loss);
  /// Counts the Gaussians that are not finite. A few are an accident that the next refinement
  /// removes.
  void check_parameters();
  void check_is_not_empty();
  /// Ends the steps after `before`. True where the model broke down and the run went back: to the
  /// last checkpoint, or to its start.
  bool checkpoint_or_roll_back(int before, bool is_stopped);

  /// How far the run is, as checkpoints have it. Waits for the device.
  RunProgress progress();

  /// The view that a step trains on in place of `view`: the next one where that one keeps breaking
  /// the model.
  std::size_t instead_of(std::size_t view) const { return guard_.instead_of(view); }

  /// From here on the model is becoming a result. It is no longer a state to go on from, so that no
  /// checkpoint is kept.
  void begin_finish() { phase_ = Phase::finishing; }
  /// From here on only the parameters are needed. Where memory runs out the moments are released,
  /// too.
  void end_finish() { phase_ = Phase::finished; }

 private:
  enum class Phase { training, finishing, finished };

  bool fits(const std::string& what, const std::function<void()>& f);
  void release_memory(const std::string& what);
  void restore(TrainingState from);
  bool save();
  void keep_checkpoint();
  bool checkpoint_is_due(int before, bool is_stopped) const;
  void roll_back();

  TrainingRun& run_;
  CheckpointStore* store_ = nullptr;
  CheckpointTimer timer_;
  RunGuard guard_;
  Phase phase_ = Phase::training;
  std::string breakdown_;     // why the model is of no use any more; empty: it is sound
  bool blames_view_ = true;   // the breakdown is the fault of the step's view
  std::string memory_error_;  // what was said when memory last ran out
};

}  // namespace gs
