// SPDX-License-Identifier: Apache-2.0
// profile.csv: how long the stages of a step take, and how much memory is held, as a run goes on.
#pragma once

#include "gs_app/observers/train_observers.h"

namespace gs {

/// Takes one sample every train.log_every steps: the stages' times of the step after a row of
/// metrics.csv, and the memory that is held then. The sample is written at the next row, where the
/// trainer waits for the device anyway, so that a sample costs no wait of its own. Add this
/// observer last: what other observers render is then not timed.
class ProfileObserver final : public Observer {
 public:
  /// Starts the file with its header and `rows`, which a resumed run has written before.
  ProfileObserver(const RunFolder& folder, const EvaluationObserver& evaluations, LostWrites& lost,
                  const std::string& rows = {});
  void after_step(int step, Trainer& trainer) override;
  void after_rollback(int step, Trainer& trainer) override;

  /// The rows of a profile.csv up to `step`: what a run keeps that goes on after it.
  static std::string rows_up_to(const std::filesystem::path& profile, int step);

 private:
  void write_rows(int step, Trainer& trainer);

  const EvaluationObserver& evaluations_;
  GrowingCsv file_;
  bool is_timing_ = false;
  int timed_step_ = 0;  // the step whose times are not written yet; 0: none
};

}  // namespace gs
