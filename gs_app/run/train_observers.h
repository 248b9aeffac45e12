// SPDX-License-Identifier: Apache-2.0
// Who watches a training run: the progress line, the saver, the evaluator and metrics.csv. None of them
// changes what is learned. Add them in this order: metrics.csv holds what the evaluator found.
#pragma once

#include <optional>
#include <string>

#include "gs_app/run/progress_bar.h"
#include "gs_app/run/run_folder.h"
#include "gs_train/metrics.h"
#include "gs_train/trainer.h"

namespace gs {

/// The progress line: step, loss, Gaussians, steps per second, time left. Remembers the last step, too.
class ProgressObserver final : public Observer {
 public:
  ProgressObserver(int steps, bool enabled) : bar_(steps, enabled) {}
  void after_step(int step, Trainer& trainer) override;
  void after_run(Trainer&) override { bar_.clear(); }
  /// Makes room for other lines.
  void clear() { bar_.clear(); }
  int last_step() const { return last_step_; }

 private:
  ProgressBar bar_;
  int last_step_ = 0;
};

/// Saves the PLY after the steps that train.save_steps names; the last one is the caller's.
class SaveObserver final : public Observer {
 public:
  explicit SaveObserver(const RunFolder& folder) : folder_(folder) {}
  void after_step(int step, Trainer& trainer) override;

 private:
  const RunFolder& folder_;
};

/// Evaluates the test views after the steps that train.test_steps names; the last one is the caller's.
class EvaluationObserver final : public Observer {
 public:
  explicit EvaluationObserver(ProgressObserver& progress) : progress_(progress) {}
  void after_step(int step, Trainer& trainer) override;
  /// What was found after this very step, if it was evaluated.
  const Evaluation* at(int step) const { return step == step_ ? &evaluation_ : nullptr; }

 private:
  ProgressObserver& progress_;
  int step_ = 0;
  Evaluation evaluation_;
};

/// What is left of a metrics.csv when a run goes on after `step`: whole rows up to it.
std::string metrics_up_to(const std::filesystem::path& metrics, int step);

/// metrics.csv: one row every train.log_every steps and for each evaluation. The row of the last step is
/// written by finish(), when the final figures are known. The file grows as the run goes on.
class MetricsObserver final : public Observer {
 public:
  /// Starts the file, or goes on after `rows` of what a resumed run wrote.
  MetricsObserver(const RunFolder& folder, const EvaluationObserver& evaluations,
                  const std::string& rows = {});
  void after_step(int step, Trainer& trainer) override;
  void after_rollback(int step, Trainer& trainer) override;
  void finish(int step, Trainer& trainer, const Evaluation& test);
  /// That of the last row; nothing before the first.
  std::optional<double> last_loss() const { return last_loss_; }

 private:
  void go_on_after(const std::string& rows);
  void write_row(int step, Trainer& trainer, const Evaluation* test);

  std::filesystem::path path_;
  const EvaluationObserver& evaluations_;
  int last_row_ = 0;
  double last_seconds_ = 0;
  std::optional<double> last_loss_;
};

/// Saves it to its place in the run's folder.
void save_model(const RunFolder& folder, int step, Trainer& trainer);

}  // namespace gs
