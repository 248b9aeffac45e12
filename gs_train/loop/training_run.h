// SPDX-License-Identifier: Apache-2.0
// The state of a run between two steps.
#pragma once

#include <chrono>
#include <memory>

#include "gs_core/config/config.h"
#include "gs_core/scene.h"
#include "gs_train/backend.h"
#include "gs_train/density/density_control.h"
#include "gs_train/schedule.h"

namespace gs {

/// What a run trains, on what, by which settings, and how far it is. Trainer takes its steps;
/// RunRecovery copies it into checkpoints and back.
struct TrainingRun {
  const Scene& scene;
  Config config;
  Backend& backend;
  Schedule schedule;
  RenderSettings settings;  // of the next step
  TrainingModel model;
  std::unique_ptr<DensityControl> density;
  int step = 0;              // steps done
  int first_step = 1;        // the first that this process takes, or takes again
  double restored_loss = 0;  // of the step before first_step
  double train_seconds = 0;  // in steps and density control; observers are not counted

  bool is_over() const { return step >= schedule.steps(); }
  /// The model after all steps so far. Waits for the device.
  TrainingModel& synchronized_model();
  /// The loss of the last step. Waits for the device.
  double loss();
};

/// Adds the time until the end of its block to train_seconds.
class TrainingTime {
 public:
  explicit TrainingTime(TrainingRun& run) : run_(run) {}
  ~TrainingTime() {
    run_.train_seconds += std::chrono::duration<double>(Clock::now() - begin_).count();
  }
  TrainingTime(const TrainingTime&) = delete;
  TrainingTime& operator=(const TrainingTime&) = delete;

 private:
  using Clock = std::chrono::steady_clock;
  TrainingRun& run_;
  Clock::time_point begin_ = Clock::now();
};

inline TrainingModel& TrainingRun::synchronized_model() {
  const TrainingTime time(*this);
  backend.synchronize(model);
  return model;
}

inline double TrainingRun::loss() {
  if (step < first_step) return restored_loss;
  const TrainingTime time(*this);
  return backend.loss().value();
}

}  // namespace gs
