// SPDX-License-Identifier: Apache-2.0
#include "apps/python/progress.h"

namespace py = pybind11;

namespace gs::python {
namespace {

// Between two checks for Ctrl-C, since taking the GIL may cost some milliseconds.
constexpr auto kSignalsEvery = std::chrono::milliseconds(50);

}  // namespace

ModelPointer model_of(Trainer& trainer) {
  auto model = std::make_shared<Model>();
  model->model = trained_model(trainer);
  model->config = trainer.config();
  model->config.train = {};
  return model;
}

void CallbackObserver::after_step(int step, Trainer& trainer) {
  const bool is_last = step == trainer.schedule().steps();
  if (is_last || step % trainer.config().train.log_every == 0) note(trainer);
  if (failure_) return;  // the run ends after this step
  const bool is_due = has_callback_ && (is_last || step % every_ == 0);
  if (!is_due && Clock::now() < next_look_) return;
  try {
    look(is_due, trainer);
  } catch (...) {
    if (!saves_first_) throw;
    failure_ = std::current_exception();
    trainer.stop();
  }
}

void CallbackObserver::look(bool is_due, Trainer& trainer) {
  const py::gil_scoped_acquire gil;
  if (PyErr_CheckSignals()) throw py::error_already_set();
  next_look_ = Clock::now() + kSignalsEvery;
  if (!is_due) return;
  const auto progress = std::make_shared<Progress>(trainer);
  const struct End {
    Progress& progress;
    ~End() { progress.end(); }
  } end{*progress};
  if (!callback_(progress).cast<bool>()) trainer.stop();
  trainer.backend().device().make_current();  // the callback may have used another GPU
}

void bind_progress(py::module_& module) {
  py::class_<Progress, std::shared_ptr<Progress>> progress(
      module, "Progress",
      "A run after a step. It can be used only while the callback that got it runs, or until the "
      "Trainer's next step, in the same thread.");
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
