// SPDX-License-Identifier: Apache-2.0
// gemsplat.Progress, and the observer that calls back to Python.
#pragma once

#include <chrono>
#include <exception>
#include <memory>
#include <thread>
#include <vector>

#include "apps/python/module.h"
#include "gs_core/error.h"
#include "gs_train/loop/trainer.h"

namespace gs::python {

/// The trained model as the run would leave it if it ended now; a copy. Waits for the device.
ModelPointer model_of(Trainer& trainer);

/// The object that a callback gets: the run after a step. It is valid while the callback runs, or
/// until the next step of a gemsplat.Trainer, in its thread.
class Progress {
 public:
  explicit Progress(Trainer& trainer) : trainer_(&trainer), thread_(std::this_thread::get_id()) {}
  void end() { trainer_ = nullptr; }
  Trainer& trainer() const {
    if (!trainer_ || std::this_thread::get_id() != thread_)
      throw UsageError(
          "progress can be used only while the callback that got it runs, or until the trainer's "
          "next step, in the same thread");
    return *trainer_;
  }

 private:
  Trainer* trainer_;
  std::thread::id thread_;
};

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
  /// The callback returns whether the run goes on; None is no callback. Its exception, or Ctrl-C,
  /// ends the run: at once, or where the run `saves_first`, after one more step, so that model and
  /// checkpoint can be saved before rethrow_failure() throws it.
  CallbackObserver(const pybind11::object& callback, int every, bool saves_first)
      : callback_(callback), has_callback_(!callback.is_none()), saves_first_(saves_first),
        every_(every) {}
  void after_step(int step, Trainer& trainer) override;
  void after_rollback(int step, Trainer&) override {
    while (!rows_.empty() && rows_.back().step > step) rows_.pop_back();
  }
  void after_run(Trainer& trainer) override {
    if (rows_.empty() || rows_.back().step != trainer.step()) note(trainer);  // was stopped
  }

  const std::vector<MetricsRow>& rows() const { return rows_; }
  /// Throws what ended the run, if anything did.
  void rethrow_failure() const {
    if (failure_) std::rethrow_exception(failure_);
  }

 private:
  using Clock = std::chrono::steady_clock;

  void note(Trainer& trainer) {
    rows_.push_back(
        {trainer.step(), trainer.loss(), trainer.gaussian_count(), trainer.train_seconds()});
  }
  void look(bool is_due, Trainer& trainer);

  const pybind11::object& callback_;
  const bool has_callback_, saves_first_;
  int every_;
  std::exception_ptr failure_;
  Clock::time_point next_look_{};
  std::vector<MetricsRow> rows_;
};

}  // namespace gs::python
