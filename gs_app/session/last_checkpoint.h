// SPDX-License-Identifier: Apache-2.0
// The checkpoint of the last step, written while the run goes on to its end.
#pragma once

#include <future>

#include "gs_app/checkpoints/checkpoint_folder.h"

namespace gs {

/// Keeps checkpoints in a folder. That of the last step is copied out of a device's memory, and
/// written by a thread of its own; all others, and that of a model in host memory, are written at
/// once. The folder outlives it.
class LastCheckpoint final : public CheckpointStore {
 public:
  LastCheckpoint(CheckpointFolder& folder, int last_step)
      : folder_(folder), last_step_(last_step) {}

  bool save(const RunProgress& progress, const TrainingModel& model) override;
  std::optional<TrainingState> newest() override;
  /// Waits until it is written; a warning says where it could not be.
  void wait();

 private:
  CheckpointFolder& folder_;
  int last_step_;
  std::future<void> written_;
};

}  // namespace gs
