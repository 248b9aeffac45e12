// SPDX-License-Identifier: Apache-2.0
// gemsplat.Progress, and the observer that calls back to Python.
#pragma once

#include <pybind11/pybind11.h>

#include <chrono>
#include <exception>
#include <memory>
#include <thread>
#include <vector>

#include "apps/python/model.h"
#include "gs_train/loop/trainer.h"

namespace gs::python {

/// The trained model as the run would leave it if it ended now; a copy. Waits for the device.
std::shared_ptr<Model> model_of(Trainer& trainer);

/// A row of Result.metrics.
struct MetricsRow {
  int step;
  double loss;
  std::size_t gaussian_count;
  double seconds;  // of training
};

/// Records metrics, checks for Ctrl-C, and calls back. Holds the GIL only for the latter two.
class CallbackObserver final : public Observer {
 public:
  /// An exception of the callback, or Ctrl-C, ends the run: at once, or after one more step, so
  /// that model and checkpoint can be saved before rethrow_failure() throws it.
  enum class OnFailure { throw_at_once, stop_first };

  CallbackObserver(pybind11::object callback, int every, OnFailure on_failure);
  void after_step(int step, Trainer& trainer) override;
  void after_rollback(int step, Trainer&) override;
  void after_run(Trainer& trainer) override;

  const std::vector<MetricsRow>& rows() const { return rows_; }
  /// Throws what ended the run, if anything did.
  void rethrow_failure() const {
    if (failure_) std::rethrow_exception(failure_);
  }

 private:
  using Clock = std::chrono::steady_clock;

  void note(Trainer& trainer);
  void look(bool is_due, Trainer& trainer);
  void call_back(Trainer& trainer);

  pybind11::object callback_;
  const bool has_callback_;
  int every_;
  OnFailure on_failure_;
  std::exception_ptr failure_;
  Clock::time_point next_look_{};
  std::vector<MetricsRow> rows_;
};

void bind_progress(pybind11::module_& module);

}  // namespace gs::python
