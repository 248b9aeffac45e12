// SPDX-License-Identifier: Apache-2.0
// How a program takes part in a training session: it shows progress, and adds observers of its own.
#pragma once

#include <cstdint>

#include "data_loaders/reconstruct/run_colmap.h"
#include "data_loaders/scene/load_scene.h"
#include "gs_app/observers/train_observers.h"
#include "gs_app/run/run_folder.h"
#include "gs_core/config/config.h"
#include "gs_core/scene.h"
#include "gs_core/threads/parallel.h"
#include "gs_train/loop/trainer.h"

namespace gs {

/// A session calls these, in this order, from the thread that runs it. By default none of them does
/// more than is needed.
class SessionHooks {
 public:
  virtual ~SessionHooks() = default;

  /// Makes the CPU's parallel loops use that many threads; 0: all cores.
  virtual void use_threads(int threads) { set_thread_count(threads); }
  /// COLMAP looks for the cameras of photos that have none.
  virtual void show_colmap(ColmapStage, [[maybe_unused]] std::int64_t done,
                           [[maybe_unused]] std::int64_t total) {}
  /// The scene is being read.
  virtual void show_loading(LoadStage, [[maybe_unused]] std::size_t done,
                            [[maybe_unused]] std::size_t total) {}
  /// The scene is there, and the run's folder is untouched so far: the place for what may fail.
  virtual void before_writing(const RunFolder&, const Scene&, const Config&) {}
  /// The trainer has all observers of the session; more may be added. The last two arguments
  /// outlive the run.
  virtual void before_training(Trainer&, const MetricsObserver&, const EvaluationObserver&) {}
  /// The trained model is saved, and its views are being rendered and compared with their photos.
  virtual void show_evaluation([[maybe_unused]] std::size_t done,
                               [[maybe_unused]] std::size_t total) {}
};

}  // namespace gs
