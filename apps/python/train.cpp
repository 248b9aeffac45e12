// SPDX-License-Identifier: Apache-2.0
#include "apps/python/train.h"

#include <pybind11/stl.h>
#include <pybind11/stl/filesystem.h>
#include <spdlog/fmt/fmt.h>

#include <optional>

#include "apps/python/devices.h"
#include "apps/python/model.h"
#include "apps/python/progress.h"
#include "apps/python/scene.h"
#include "apps/python/settings.h"
#include "gs_app/run/make_backend.h"
#include "gs_app/session/train_session.h"
#include "gs_core/error.h"
#include "gs_eval/evaluate_run.h"
#include "gs_eval/lpips/lpips.h"
#include "gs_eval/metrics.h"
#include "gs_train/loop/trainer.h"

namespace py = pybind11;

namespace gs::python {
namespace {

namespace fs = std::filesystem;

/// The arguments of train() but for the scene and what concerns callbacks.
struct Arguments {
  py::object settings;
  std::optional<int> iterations;
  std::optional<std::uint64_t> seed;
  std::optional<std::string> device;
  std::optional<fs::path> output;
  std::optional<fs::path> resume;  // "auto", or a folder or checkpoint
  std::optional<int> checkpoint_every;
  std::vector<std::string> exports;
  bool report = true, force = false;

  bool has_folder() const { return output || resume; }
};

struct Result {
  std::shared_ptr<Model> model;
  std::optional<Evaluation> evaluation;
  std::vector<MetricsRow> metrics;
  int steps = 0;
  bool stopped_early = false;
  double seconds = 0;
  std::string device, config;
  std::optional<fs::path> output;
};

// ---- settings ----------------------------------------------------------------------------------

std::string absolute_path(const fs::path& path) {
  return fs::absolute(path).lexically_normal().string();
}

// The arguments over a start. `scene` brings its own [dataset]. Holds the GIL.
Config config_of(const Arguments& arguments, const py::object& scene, Config config) {
  merge_settings(config, arguments.settings);
  if (arguments.iterations) config.train.iterations = *arguments.iterations;
  if (arguments.seed) config.train.seed = *arguments.seed;
  if (arguments.device) config.train.device = *arguments.device;
  if (arguments.output) config.model.output = arguments.output->string();
  if (arguments.checkpoint_every) config.train.checkpoint_every = *arguments.checkpoint_every;
  if (py::isinstance<LoadedScene>(scene))
    config.dataset = scene.cast<std::shared_ptr<LoadedScene>>()->dataset;
  else
    config.dataset.source = absolute_path(scene.cast<fs::path>());
  validate(config);
  return config;
}

void check(const Arguments& arguments) {
  if (arguments.has_folder()) return;
  const char* const given = arguments.checkpoint_every   ? "checkpoint_every"
                            : !arguments.exports.empty() ? "export"
                            : arguments.force            ? "force"
                                                         : nullptr;
  if (given)
    throw UsageError(std::string(given) + " needs a run with a folder: give output=FOLDER");
}

// ---- without a folder --------------------------------------------------------------------------

Evaluation evaluation_of(Trainer& trainer, Lpips* lpips) {
  return evaluate(trainer.backend().renderer(), trainer.model().gaussians.span(),
                  trainer.scene().test_views, trainer.evaluation_settings(), {},
                  evaluation_options(trainer, {true, lpips}));
}

Result result_of(Trainer& trainer, const CallbackObserver& observer) {
  Result result;
  result.model = model_of(trainer);
  result.metrics = observer.rows();
  result.steps = trainer.step();
  result.stopped_early = trainer.step() < trainer.schedule().steps();
  result.seconds = trainer.train_seconds();
  result.device = trainer.backend().name();
  result.config = to_toml(trainer.config());
  return result;
}

Result run_in_memory(const Scene& scene, const Config& config, CallbackObserver& observer) {
  if (!config.model.start_from.empty())
    throw UsageError("model.start_from needs a run with a folder: give output=FOLDER");
  const std::unique_ptr<Lpips> lpips = make_lpips(config.eval);
  if (lpips) lpips->check_sizes(scene.test_views);
  if (config.train.threads) set_threads(config.train.threads);
  const Work work;
  const std::unique_ptr<Backend> backend = make_training_backend(config.train);
  Trainer trainer(scene, config, *backend);
  trainer.add_observer(observer);
  trainer.run();
  Result result = result_of(trainer, observer);
  if (!scene.test_views.empty()) result.evaluation = evaluation_of(trainer, lpips.get());
  return result;
}

// ---- with a folder -----------------------------------------------------------------------------

class PythonHooks final : public SessionHooks {
 public:
  explicit PythonHooks(CallbackObserver& observer) : observer_(observer) {}
  void use_threads(int threads) override {
    if (threads) set_threads(threads);
    work_.emplace();
  }
  void before_training(Trainer& trainer, const MetricsObserver&,
                       const EvaluationObserver&) override {
    trainer.add_observer(observer_);
  }

 private:
  CallbackObserver& observer_;
  std::optional<Work> work_;
};

TrainRequest request_of(const Arguments& arguments, const py::object& scene) {
  TrainRequest request;
  request.settings = [&](const Config& start) {
    const py::gil_scoped_acquire gil;
    return config_of(arguments, scene, start);
  };
  if (arguments.resume) request.resume = arguments.resume->string();
  request.force = arguments.force;
  request.exports = arguments.exports;
  request.writes_report = arguments.report;
  request.shows_progress = false;
  request.stops_on_signal = false;  // Python's own handler does, by way of the observer
  return request;
}

// The result of a run that was finished before, read from its folder.
Result result_of_finished(const fs::path& folder) {
  Result result;
  result.model = std::make_shared<Model>(open_model(folder, std::nullopt));
  result.steps = result.model->run->newest_step().value_or(0);
  result.config = to_toml(result.model->config);
  return result;
}

Result run_in_folder(TrainRequest request, CallbackObserver& observer) {
  PythonHooks hooks(observer);
  TrainSession session(std::move(request), hooks);
  const SessionEnd end = session.run();
  observer.rethrow_failure();
  Result result = end == SessionEnd::nothing_left ? result_of_finished(session.folder().root())
                                                  : result_of(session.trainer(), observer);
  result.output = absolute_path(session.folder().root());
  if (end == SessionEnd::nothing_left || session.trainer().scene().test_views.empty())
    return result;
  result.evaluation = end == SessionEnd::finished
                          ? session.results().test
                          : evaluation_of(session.trainer(), session.lpips());
  return result;
}

// ---- gemsplat.train ----------------------------------------------------------------------------

Result run(const py::object& scene, const Arguments& arguments, CallbackObserver& observer) {
  ScenePointer loaded;
  if (py::isinstance<LoadedScene>(scene)) loaded = scene.cast<std::shared_ptr<LoadedScene>>();
  if (arguments.has_folder()) {
    TrainRequest request = request_of(arguments, scene);
    if (loaded) request.scene = &loaded->scene;
    const py::gil_scoped_release release;
    return run_in_folder(std::move(request), observer);
  }
  const Config config = config_of(arguments, scene, {});
  if (!loaded) loaded = load(config.dataset);
  const py::gil_scoped_release release;
  return run_in_memory(loaded->scene, config, observer);
}

// True stands for "auto"; False and None for no resume.
std::optional<fs::path> resume_of(const py::object& resume) {
  if (resume.is_none()) return std::nullopt;
  if (!is_bool(resume)) return resume.cast<fs::path>();
  if (PyObject_IsTrue(resume.ptr())) return "auto";
  return std::nullopt;
}

Result train(const py::object& scene, const py::object& settings, std::optional<int> iterations,
             std::optional<std::uint64_t> seed, std::optional<std::string> device,
             const py::object& callback, int callback_every, std::optional<fs::path> output,
             const py::object& resume, std::optional<int> checkpoint_every,
             const std::vector<std::string>& exports, bool report, bool force) {
  if (callback_every < 1) throw UsageError("callback_every must be 1 or more");
  if (!callback.is_none() && !PyCallable_Check(callback.ptr()))
    throw UsageError("callback must be a function of one argument");
  const Arguments arguments{settings,          iterations,       seed,    device, output,
                            resume_of(resume), checkpoint_every, exports, report, force};
  check(arguments);
  CallbackObserver observer(callback, callback_every,
                            arguments.has_folder() ? CallbackObserver::OnFailure::stop_first
                                                   : CallbackObserver::OnFailure::throw_at_once);
  return run(scene, arguments, observer);
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
  py::class_<Result> result(module, "Result", "The outcome of train().");
  result.def_readonly("model", &Result::model, "The trained Model.");
  result.def_readonly("evaluation", &Result::evaluation,
                      "Evaluation of the test views; None if none is held out, and for a run that "
                      "was finished before.");
  result.def_property_readonly(
      "metrics", rows_of,
      "A list of dicts, one every train.log_every steps and after the last: step, loss, "
      "gaussian_count, seconds. Holds only steps of this call.");
  result.def_readonly("steps", &Result::steps, "Steps done, including those before a resume.");
  result.def_readonly("stopped_early", &Result::stopped_early,
                      "Whether a callback ended the run before its last step.");
  result.def_readonly("seconds", &Result::seconds, "Seconds of training, without callbacks.");
  result.def_readonly("device", &Result::device, "Name of the device, as in results.json.");
  result.def_readonly("config", &Result::config, "All settings, as TOML.");
  result.def_readonly("output", &Result::output,
                      "The run's folder, a pathlib.Path; None for a run without one.");
  result.def("__repr__", [](const Result& self) {
    return fmt::format("<gemsplat.Result: {} Gaussians after {} steps on {}>",
                       self.model->model.gaussians.count(), self.steps, self.device);
  });
}

constexpr const char* kTrainHelp =
    R"(Trains Gaussians on a Scene, or on the scene in a folder, and returns a Result.

config: the name of a preset, a TOML file or a run's folder; a dict of settings, nested or with
dots in the names ({"density.max_gaussians": 100000}); or a list of these, the later over the
earlier. Settings of [dataset] are those of the Scene, where one is given. iterations, seed,
device and checkpoint_every are short for train.iterations, train.seed, and so on.

callback(progress) is called after every callback_every-th step and after the last. If it returns
False, the run ends after one more step, with a Result. If it raises an exception, or Ctrl-C comes,
the run ends at once and train() raises it. A run that went back after a breakdown reports steps
again. The GIL is released except during callbacks.

Without output nothing is written. With output=FOLDER the run writes what `gemsplat train -o
FOLDER` writes, checkpoints included: see docs/reference/run_folder.md and
docs/reference/checkpoints.md.
  resume            True: go on with the run in the output folder, or start it where there is none.
                    A path: go on with the run of that folder or checkpoint. Settings are those of
                    the run; a setting that may not change is refused (UsageError).
  checkpoint_every  steps; 0: about once a minute; -1: only when the run is stopped
  export            formats to write the trained model in, besides PLY: ["spz", "sog"]
  report            write report.html
  force             move a run that the folder holds to FOLDER.bak-N; without it such a folder is
                    refused (UsageError)
There an exception or Ctrl-C ends the run after one more step: model and checkpoint are saved, then
train() raises it.)";

}  // namespace

void bind_train(py::module_& module) {
  bind_result(module);
  module.def("train", train, py::arg("scene"), py::arg("config") = py::none(), py::kw_only(),
             py::arg("iterations") = py::none(), py::arg("seed") = py::none(),
             py::arg("device") = py::none(), py::arg("callback") = py::none(),
             py::arg("callback_every") = 100, py::arg("output") = py::none(),
             py::arg("resume") = py::none(), py::arg("checkpoint_every") = py::none(),
             py::arg("export") = std::vector<std::string>{}, py::arg("report") = true,
             py::arg("force") = false, kTrainHelp);
}

}  // namespace gs::python
