// SPDX-License-Identifier: Apache-2.0
// profile.csv: how long the stages of a step take, and how much memory is held, as a run goes on.
#pragma once

#include "gs_app/run/train_observers.h"

namespace gs {

/// One sample every train.log_every steps: the stages' times of the step after a row of metrics.csv, and the memory of the
/// moment. They are written at the next row, when the device has been waited for anyhow: a sample costs no wait of its
/// own. Add it last: what other observers render is not timed.
class ProfileObserver final : public Observer {
 public:
  /// Starts the file, or goes on after `rows` of what a resumed run wrote.
  ProfileObserver(const RunFolder& folder, const EvaluationObserver& evaluations,
                  const std::string& rows = {});
  void after_step(int step, Trainer& trainer) override;
  void after_rollback(int step, Trainer& trainer) override;

  /// What is left of a profile.csv when a run goes on after `step`.
  static std::string rows_up_to(const std::filesystem::path& profile, int step);

 private:
  void write_rows(int step, Trainer& trainer);

  std::filesystem::path path_;
  const EvaluationObserver& evaluations_;
  bool is_timing_ = false;
  int timed_step_ = 0;  // whose times are not written yet; 0: none
};

}  // namespace gs
