// SPDX-License-Identifier: Apache-2.0
// What a run can be taken up from: everything that its next step depends on, besides the scene and the config.
// docs/checkpoints.md
#pragma once

#include <cstdint>
#include <optional>
#include <vector>

#include "gs_train/training_model.h"

namespace gs {

/// How far a run is. Random numbers have no state of their own: they follow from the seed and the step.
struct RunProgress {
  int step = 0;                  // steps done; 0: before the first
  int sh_degree = 0;             // in use
  double loss = 0;               // of the last step
  double train_seconds = 0;      // so far
  std::int64_t growth_cap = 0;   // Gaussians; found out, or lowered where memory ran out; 0: as the config says
  std::vector<int> strikes;      // (training views) how often each broke the model; at kMostStrikes it is skipped
  std::vector<std::uint32_t> view_order;  // (training views) of the epoch of the last step; a check, see ViewSampler
};

/// A run after some step.
struct TrainingState {
  RunProgress progress;
  TrainingModel model;  // in host memory
};

/// Where a run keeps its checkpoints. A program implements it with files; it outlives the trainer.
class CheckpointStore {
 public:
  virtual ~CheckpointStore() = default;
  /// Keeps this state; the model is settled, in any memory. True where it is safe. Where it cannot be (a full disk) says
  /// so to the user and returns false: training goes on. Throws Error where memory runs out.
  virtual bool save(const RunProgress& progress, const TrainingModel& model) = 0;
  /// The last state that can be read whole; none where there is none.
  virtual std::optional<TrainingState> newest() = 0;
};

}  // namespace gs
