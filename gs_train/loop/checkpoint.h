// SPDX-License-Identifier: Apache-2.0
// The state that a run can be resumed from: everything that its next step depends on, besides the
// scene and the config. See docs/reference/checkpoints.md.
#pragma once

#include <cstdint>
#include <optional>
#include <vector>

#include "gs_train/training_model.h"

namespace gs {

/// How far a run is. Random numbers have no state: they are functions of the seed and the step.
struct RunProgress {
  int step = 0;              // steps done; 0: before the first
  int sh_degree = 0;         // in use
  double loss = 0;           // of the last step
  double train_seconds = 0;  // so far
  // Gaussians; from max_gaussians = auto, or lowered where memory ran out; 0: as the config says
  std::int64_t growth_cap = 0;
  // (training views) how often each broke the model; at kMostStrikes it is skipped
  std::vector<int> strikes;
  // (training views) in the epoch of the last step; only checked, see ViewSampler
  std::vector<std::uint32_t> view_order;
};

/// A run after some step.
struct TrainingState {
  RunProgress progress;
  TrainingModel model;  // in host memory
};

/// Where a run keeps its checkpoints. A program implements it with files. It outlives the trainer.
class CheckpointStore {
 public:
  virtual ~CheckpointStore() = default;
  /// Keeps this state. The model is synchronized (Backend::synchronize()), in any memory. Returns
  /// true where the state is safe. Otherwise, for example on a full disk, it warns the user and
  /// returns false, and training goes on. Throws Error where memory runs out.
  virtual bool save(const RunProgress& progress, const TrainingModel& model) = 0;
  /// The latest state that is intact; none where there is none.
  virtual std::optional<TrainingState> newest() = 0;
};

}  // namespace gs
