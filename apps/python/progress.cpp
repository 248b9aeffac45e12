// SPDX-License-Identifier: Apache-2.0
#include "apps/python/progress.h"

#include "apps/python/settings.h"
#include "gs_core/error.h"

namespace py = pybind11;

namespace gs::python {
namespace {

// Between two checks for Ctrl-C, since taking the GIL may cost some milliseconds.
constexpr auto kSignalsEvery = std::chrono::milliseconds(50);

/// The object that a callback gets: the run after a step. It is valid while the callback runs, in
/// its thread.
class Progress {
 public:
  explicit Progress(Trainer& trainer) : trainer_(&trainer), thread_(std::this_thread::get_id()) {}
  void end() { trainer_ = nullptr; }
  Trainer& trainer() const {
    if (!trainer_ || std::this_thread::get_id() != thread_)
      throw UsageError(
          "progress can be used only while the callback that got it runs, in the same thread");
    return *trainer_;
  }

 private:
  Trainer* trainer_;
  std::thread::id thread_;
};

// False of Python or of NumPy; None and 0 are not.
bool is_false(const py::handle& answer) {
  return is_bool(answer) && PyObject_IsTrue(answer.ptr()) == 0;
}

}  // namespace

std::shared_ptr<Model> model_of(Trainer& trainer) {
  auto model = std::make_shared<Model>();
  model->model = trained_model(trainer);
  model->config = trainer.config();
  model->config.train = {};
  return model;
}

CallbackObserver::CallbackObserver(py::object callback, int every, OnFailure on_failure)
    : callback_(std::move(callback)), has_callback_(!callback_.is_none()), every_(every),
      on_failure_(on_failure) {}

void CallbackObserver::after_step(int step, Trainer& trainer) {
  const bool is_last = step == trainer.schedule().steps();
  if (is_last || step % trainer.config().train.log_every == 0) note(trainer);
  if (failure_) return;  // the run ends after this step
  const bool is_due = has_callback_ && (is_last || step % every_ == 0);
  if (!is_due && Clock::now() < next_look_) return;
  try {
    look(is_due, trainer);
  } catch (...) {
    if (on_failure_ == OnFailure::throw_at_once) throw;
    failure_ = std::current_exception();
    trainer.stop();
  }
}

void CallbackObserver::after_rollback(int step, Trainer&) {
  while (!rows_.empty() && rows_.back().step > step) rows_.pop_back();
}

void CallbackObserver::after_run(Trainer& trainer) {
  if (rows_.empty() || rows_.back().step != trainer.step()) note(trainer);  // was stopped
}

void CallbackObserver::note(Trainer& trainer) {
  rows_.push_back(
      {trainer.step(), trainer.loss(), trainer.gaussian_count(), trainer.train_seconds()});
}

void CallbackObserver::look(bool is_due, Trainer& trainer) {
  const py::gil_scoped_acquire gil;
  if (PyErr_CheckSignals()) throw py::error_already_set();
  next_look_ = Clock::now() + kSignalsEvery;
  if (is_due) call_back(trainer);
}

void CallbackObserver::call_back(Trainer& trainer) {
  const auto progress = std::make_shared<Progress>(trainer);
  const struct End {
    Progress& progress;
    ~End() { progress.end(); }
  } end{*progress};
  if (is_false(callback_(progress))) trainer.stop();
  trainer.backend().device().make_current();  // the callback may have used another GPU
}

void bind_progress(py::module_& module) {
  py::class_<Progress, std::shared_ptr<Progress>> progress(
      module, "Progress",
      "A run after a step. It can be used only while the callback that got it runs, in the same "
      "thread.");
  progress.def_property_readonly(
      "step", [](const Progress& self) { return self.trainer().step(); }, "Steps done, from 1.");
  progress.def_property_readonly(
      "steps", [](const Progress& self) { return self.trainer().schedule().steps(); },
      "Steps of the whole run.");
  progress.def_property_readonly(
      "loss",
      [](const Progress& self) {
        Trainer& trainer = self.trainer();
        const py::gil_scoped_release release;
        return trainer.loss();
      },
      "Loss of the last step. Waits for the device.");
  progress.def_property_readonly(
      "gaussian_count", [](const Progress& self) { return self.trainer().gaussian_count(); },
      "Number of Gaussians.");
  progress.def_property_readonly(
      "seconds", [](const Progress& self) { return self.trainer().train_seconds(); },
      "Seconds of training so far, without callbacks.");
  progress.def(
      "snapshot",
      [](const Progress& self) {
        Trainer& trainer = self.trainer();
        const py::gil_scoped_release release;
        return model_of(trainer);
      },
      "The Model as the run would leave it if it ended now; a copy.");
}

}  // namespace gs::python
