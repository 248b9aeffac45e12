// SPDX-License-Identifier: Apache-2.0
// The observers of a training run: the progress line, the saver, the evaluator and metrics.csv.
// None of them changes what is learned. Add them in this order, since metrics.csv holds what the
// evaluator found.
#pragma once

#include <optional>
#include <string>
#include <vector>

#include "gs_app/observers/lost_writes.h"
#include "gs_app/run/progress_bar.h"
#include "gs_app/run/run_folder.h"
#include "gs_eval/metrics.h"
#include "gs_train/loop/trainer.h"

namespace gs {

/// The progress line: step, loss, Gaussians, steps per second, time left.
class ProgressObserver final : public Observer {
 public:
  /// `done`: steps of a resumed run that this process did not take.
  ProgressObserver(int steps, bool enabled, int done = 0) : bar_(steps, enabled, done) {}
  void after_step(int step, Trainer& trainer) override;
  void after_run(Trainer&) override { bar_.clear(); }
  /// Removes the line, so that other lines can be written.
  void clear() { bar_.clear(); }

 private:
  ProgressBar bar_;
};

/// Says once, after the first 50 steps, about how long the rest of the run takes on this machine.
class DurationObserver final : public Observer {
 public:
  DurationObserver(ProgressObserver& progress, Trainer& trainer)
      : progress_(progress), first_step_(trainer.step()), first_seconds_(trainer.train_seconds()) {}
  void after_step(int step, Trainer& trainer) override;

 private:
  ProgressObserver& progress_;
  int first_step_;
  double first_seconds_;
};

/// Saves the PLY after the steps that train.save_steps names. The caller saves the last one.
class SaveObserver final : public Observer {
 public:
  SaveObserver(const RunFolder& folder, LostWrites& lost) : folder_(folder), lost_(lost) {}
  void after_step(int step, Trainer& trainer) override;

 private:
  const RunFolder& folder_;
  LostWrites& lost_;
};

/// Evaluates the test views after the steps that train.test_steps names. The caller evaluates the
/// last one.
class EvaluationObserver final : public Observer {
 public:
  explicit EvaluationObserver(ProgressObserver& progress) : progress_(progress) {}
  void after_step(int step, Trainer& trainer) override;
  /// The evaluation after `step`; null where that step was not evaluated.
  const Evaluation* at(int step) const { return step == step_ ? &evaluation_ : nullptr; }

 private:
  ProgressObserver& progress_;
  int step_ = 0;
  Evaluation evaluation_;
};

/// The whole rows of a metrics.csv up to `step`: what a run keeps that goes on after it.
std::string metrics_up_to(const std::filesystem::path& metrics, int step);

/// Step and loss of one row of metrics.csv.
struct LoggedLoss {
  int step;
  double loss;
};

/// metrics.csv: one row every train.log_every steps and for each evaluation. The row of the last
/// step is written by finish(), when the final figures are known. The file grows as the run goes
/// on. Rows that a full disk has no place for are written with a later one.
class MetricsObserver final : public Observer {
 public:
  /// Starts the file with its header and `rows`, which a resumed run has written before.
  MetricsObserver(const RunFolder& folder, const EvaluationObserver& evaluations, LostWrites& lost,
                  const std::string& rows = {});
  void after_step(int step, Trainer& trainer) override;
  void after_rollback(int step, Trainer& trainer) override;
  void finish(int step, Trainer& trainer, const Evaluation& test);
  /// Those of all rows, also of the rows that a resumed run wrote.
  const std::vector<LoggedLoss>& losses() const { return losses_; }

 private:
  void take_rows();
  void write_row(int step, Trainer& trainer, const Evaluation* test);

  const EvaluationObserver& evaluations_;
  GrowingCsv file_;
  int last_row_ = 0;
  double last_seconds_ = 0;
  std::vector<LoggedLoss> losses_;
};

/// Saves the model to its place in the run's folder.
void save_model(const RunFolder& folder, int step, Trainer& trainer);

}  // namespace gs
