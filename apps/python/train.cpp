// SPDX-License-Identifier: Apache-2.0
#include "apps/python/train.h"

#include <pybind11/stl.h>
#include <pybind11/stl/filesystem.h>
#include <spdlog/fmt/fmt.h>

#include <chrono>
#include <optional>
#include <thread>

#include "apps/python/devices.h"
#include "apps/python/model.h"
#include "apps/python/scene.h"
#include "apps/python/settings.h"
#include "gs_app/run/make_backend.h"
#include "gs_core/error.h"
#include "gs_train/metrics.h"
#include "gs_train/trainer.h"

namespace py = pybind11;

namespace gs::python {
namespace {

using Clock = std::chrono::steady_clock;
constexpr auto kSignalsEvery = std::chrono::milliseconds(50);  // Ctrl-C is asked for; the GIL may take some ms to be had

std::shared_ptr<Model> model_of(Trainer& trainer) {
  auto model = std::make_shared<Model>();
  model->model = trained_model(trainer);
  model->config = trainer.config();
  model->config.train = {};
  return model;
}

/// What a callback is given: the run after a step, for as long as the callback lasts, in its thread.
class Progress {
 public:
  explicit Progress(Trainer& trainer) : trainer_(&trainer), thread_(std::this_thread::get_id()) {}
  void end() { trainer_ = nullptr; }
  Trainer& trainer() const {
    if (!trainer_ || std::this_thread::get_id() != thread_)
      throw UsageError(
          "progress is of use only while the callback that got it runs, in its thread");
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

/// False of Python or of NumPy; None and other things are not.
bool is_false(const py::handle& answer) {
  return is_bool(answer) && PyObject_IsTrue(answer.ptr()) == 0;
}

/// Logs, asks for signals and calls back. Holds the GIL only for the latter two.
class CallbackObserver final : public Observer {
 public:
  CallbackObserver(py::object callback, int every)
      : callback_(std::move(callback)), every_(every) {}

  void after_step(int step, Trainer& trainer) override {
    const bool is_last = step == trainer.schedule().steps();
    if (is_last || step % trainer.config().train.log_every == 0) note(trainer);
    const bool is_due = has_callback_ && (is_last || step % every_ == 0);
    if (!is_due && Clock::now() < next_look_) return;
    const py::gil_scoped_acquire gil;
    if (PyErr_CheckSignals()) throw py::error_already_set();
    next_look_ = Clock::now() + kSignalsEvery;
    if (is_due) call_back(trainer);
  }
  void after_rollback(int step, Trainer&) override {
    while (!rows_.empty() && rows_.back().step > step) rows_.pop_back();
  }
  void after_run(Trainer& trainer) override {
    if (rows_.empty() || rows_.back().step != trainer.step()) note(trainer);  // was stopped
  }
  std::vector<MetricsRow> rows() const { return rows_; }

 private:
  void note(Trainer& trainer) {
    rows_.push_back(
        {trainer.step(), trainer.loss(), trainer.gaussian_count(), trainer.train_seconds()});
  }
  void call_back(Trainer& trainer) {
    const auto progress = std::make_shared<Progress>(trainer);
    const struct End {
      Progress& progress;
      ~End() { progress.end(); }
    } end{*progress};
    if (is_false(callback_(progress))) trainer.stop();
    trainer.backend().make_current();  // the callback may have used another GPU
  }

  py::object callback_;
  const bool has_callback_ = !callback_.is_none();
  int every_;
  Clock::time_point next_look_{};
  std::vector<MetricsRow> rows_;
};

struct Result {
  std::shared_ptr<Model> model;
  std::optional<Evaluation> evaluation;
  std::vector<MetricsRow> metrics;
  int steps = 0;
  bool stopped_early = false;
  double seconds = 0;
  std::string device, config;
};

Result run(const Scene& scene, const Config& config, CallbackObserver& observer) {
  if (config.train.threads) set_threads(config.train.threads);
  const Work work;
  const std::unique_ptr<Backend> backend = make_backend(config.train.device);
  Trainer trainer(scene, config, *backend);
  trainer.add_observer(observer);
  trainer.run();
  Result result;
  result.model = model_of(trainer);
  if (!scene.test_views.empty())
    result.evaluation = evaluate(backend->renderer(), trainer.model().gaussians.span(),
                                 scene.test_views, trainer.evaluation_settings());
  result.metrics = observer.rows();
  result.steps = trainer.step();
  result.stopped_early = trainer.step() < trainer.schedule().steps();
  result.seconds = trainer.train_seconds();
  result.device = backend->name();
  result.config = to_toml(trainer.config());
  return result;
}

// The scene itself, or that in a folder, as the config says.
ScenePointer scene_of(const py::object& scene, Config& config) {
  ScenePointer loaded;
  if (py::isinstance<LoadedScene>(scene)) {
    loaded = scene.cast<std::shared_ptr<LoadedScene>>();
    config.dataset = loaded->dataset;
    validate(config);
    return loaded;
  }
  const auto path = scene.cast<std::filesystem::path>();
  config.dataset.source = std::filesystem::absolute(path).lexically_normal().string();
  validate(config);
  return load(config.dataset);
}

Result train(const py::object& scene, const py::object& settings, std::optional<int> iterations,
             std::optional<std::uint64_t> seed, std::optional<std::string> device,
             const py::object& callback, int callback_every) {
  if (callback_every < 1) throw UsageError("callback_every must be 1 or more");
  if (!callback.is_none() && !PyCallable_Check(callback.ptr()))
    throw UsageError("callback must be a function of one argument");
  Config config;
  merge_settings(config, settings);
  if (iterations) config.train.iterations = *iterations;
  if (seed) config.train.seed = *seed;
  if (device) config.train.device = *device;
  const ScenePointer loaded = scene_of(scene, config);
  CallbackObserver observer(callback, callback_every);
  const py::gil_scoped_release release;
  return run(loaded->scene, config, observer);
}

void bind_progress(py::module_& module) {
  py::class_<Progress, std::shared_ptr<Progress>> progress(
      module, "Progress",
      "A run after a step. Of use only while the callback that got it runs, in its thread.");
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
      "Of the last step; waits for the device.");
  progress.def_property_readonly(
      "gaussian_count", [](const Progress& self) { return self.trainer().gaussian_count(); });
  progress.def_property_readonly(
      "seconds", [](const Progress& self) { return self.trainer().train_seconds(); },
      "Of training so far, without callbacks.");
  progress.def(
      "snapshot",
      [](const Progress& self) {
        Trainer& trainer = self.trainer();
        const py::gil_scoped_release release;
        return model_of(trainer);
      },
      "The Model as the run would leave it if it ended here; a copy.");
}

py::list rows_of(const Result& result) {
  py::list rows;
  for (const MetricsRow& row : result.metrics)
    rows.append(py::dict(py::arg("step") = row.step, py::arg("loss") = row.loss,
                         py::arg("gaussian_count") = row.gaussian_count,
                         py::arg("seconds") = row.seconds));
  return rows;
}

void bind_result(py::module_& module) {
  py::class_<Result> result(module, "Result", "What train() came to.");
  result.def_readonly("model", &Result::model, "The trained Model.");
  result.def_readonly("evaluation", &Result::evaluation,
                      "Evaluation of the test views; None where none is held out.");
  result.def_property_readonly("metrics", rows_of,
                               "A dict every train.log_every steps and after the last: step, loss, "
                               "gaussian_count, seconds.");
  result.def_readonly("steps", &Result::steps, "Steps done.");
  result.def_readonly("stopped_early", &Result::stopped_early,
                      "Whether a callback ended the run before its last step.");
  result.def_readonly("seconds", &Result::seconds, "Of training, without callbacks.");
  result.def_readonly("device", &Result::device, "As in results.json.");
  result.def_readonly("config", &Result::config, "All settings, as TOML.");
  result.def("__repr__", [](const Result& self) {
    return fmt::format("<gemsplat.Result: {} Gaussians after {} steps on {}>",
                       self.model->model.gaussians.count(), self.steps, self.device);
  });
}

}  // namespace

void bind_train(py::module_& module) {
  bind_progress(module);
  bind_result(module);
  module.def("train", train, py::arg("scene"), py::arg("config") = py::none(), py::kw_only(),
             py::arg("iterations") = py::none(), py::arg("seed") = py::none(),
             py::arg("device") = py::none(), py::arg("callback") = py::none(),
             py::arg("callback_every") = 100,
             R"(Trains Gaussians on a Scene, or on the scene in a folder, and returns a Result.

config: the name of a preset, a TOML file or a run's folder; a dict of settings, nested or with
dots in the names ({"density.max_gaussians": 100000}); or a list of these, the later over the
earlier. Settings of [dataset] are those of the Scene, where one is given. iterations, seed and
device are short for train.iterations, train.seed and train.device.

callback(progress) is called after every callback_every-th step and after the last. Returning
False ends the run after one more step, with a Result; an exception ends it at once, and comes out of
train(), as Ctrl-C does. A run that went back after a breakdown reports steps again. The GIL is
released but for callbacks. Nothing is written.)");
}

}  // namespace gs::python
