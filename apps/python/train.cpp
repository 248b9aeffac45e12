// SPDX-License-Identifier: Apache-2.0
#include <pybind11/stl.h>
#include <pybind11/stl/filesystem.h>

#include <optional>

#include "apps/python/devices.h"
#include "apps/python/module.h"
#include "apps/python/progress.h"
#include "apps/python/training.h"
#include "gs_app/run/make_backend.h"
#include "gs_app/session/train_session.h"
#include "gs_core/error.h"
#include "gs_eval/evaluate_run.h"
#include "gs_eval/lpips/lpips.h"
#include "gs_train/loop/trainer.h"

namespace py = pybind11;

namespace gs::python {
namespace {

namespace fs = std::filesystem;

std::string absolute_path(const fs::path& path) {
  return fs::absolute(path).lexically_normal().string();
}

/// What train() is asked for, but for callbacks.
struct Arguments {
  ScenePointer scene;   // null: that of the settings
  std::string config;   // as apply_settings() takes it
  FilledVerb keywords;  // of the verb train
  bool has_folder, writes_report;
};

/// The outcome of train(), but for rows of metrics.
struct Result {
  ModelPointer model;
  std::optional<Evaluation> evaluation;
  int steps = 0;
  bool stopped_early = false;
  double seconds = 0;
  std::string device, config;
  std::optional<fs::path> output;
};

Config config_of(const Arguments& arguments, Config start) {
  return config_of_run(arguments.scene, arguments.config, arguments.keywords, std::move(start));
}

// ---- without a folder --------------------------------------------------------------------------

Result result_of(Trainer& trainer) {
  Result result;
  result.model = model_of(trainer);
  result.steps = trainer.step();
  result.stopped_early = trainer.step() < trainer.schedule().steps();
  result.seconds = trainer.train_seconds();
  result.device = trainer.backend().name();
  result.config = to_toml(trainer.config());
  return result;
}

Result run_in_memory(const Arguments& arguments, CallbackObserver& observer) {
  const Config config = config_of(arguments, {});
  if (!config.model.start_from.empty())
    throw UsageError("model.start_from needs a run with a folder: give output=FOLDER");
  const ScenePointer loaded = arguments.scene ? arguments.scene : load(config);
  const Scene& scene = loaded->scene;
  const std::unique_ptr<Lpips> lpips = make_lpips(config.eval);
  if (lpips) lpips->check_sizes(scene.test_views);
  if (config.train.threads) set_threads(config.train.threads);
  const Work work;
  const std::unique_ptr<Backend> backend = make_training_backend(config.train);
  Trainer trainer(scene, config, *backend);
  trainer.add_observer(observer);
  trainer.run();
  Result result = result_of(trainer);
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

TrainRequest request_of(const Arguments& arguments) {
  TrainRequest request;
  request.settings = [&](const Config& start) { return config_of(arguments, start); };
  request.resume = arguments.keywords.get<std::string>("--resume");
  request.force = arguments.keywords.get<bool>("--force");
  request.exports = arguments.keywords.get<std::vector<std::string>>("--export");
  request.writes_report = arguments.writes_report;
  request.shows_progress = false;
  request.stops_on_signal = false;  // Python's own handler does, by way of the observer
  if (arguments.scene) request.scene = &arguments.scene->scene;
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

Result run_in_folder(Arguments& arguments, CallbackObserver& observer) {
  TrainRequest request = request_of(arguments);
  request.added_steps = extract_added_steps(arguments.keywords.settings().flags);
  PythonHooks hooks(observer);
  TrainSession session(std::move(request), hooks);
  const SessionEnd end = session.run();
  observer.rethrow_failure();
  Result result = end == SessionEnd::nothing_left ? result_of_finished(session.folder().root())
                                                  : result_of(session.trainer());
  result.output = absolute_path(session.folder().root());
  if (end == SessionEnd::nothing_left || session.trainer().scene().test_views.empty())
    return result;
  result.evaluation = end == SessionEnd::finished
                          ? session.results().test
                          : evaluation_of(session.trainer(), session.lpips());
  return result;
}

// ---- gemsplat.train ----------------------------------------------------------------------------

py::dict train(const ScenePointer& scene, const std::string& config, const std::string& keywords,
               bool has_folder, const py::object& callback, int callback_every, bool report) {
  Arguments arguments{scene, config, FilledVerb("train", Json::parse(keywords)), has_folder,
                      report};
  CallbackObserver observer(callback, callback_every, arguments.has_folder);
  Result result;
  {
    const py::gil_scoped_release release;
    result = arguments.has_folder ? run_in_folder(arguments, observer)
                                  : run_in_memory(arguments, observer);
  }
  py::list rows;
  for (const MetricsRow& row : observer.rows())
    rows.append(py::dict(py::arg("step") = row.step, py::arg("loss") = row.loss,
                         py::arg("gaussian_count") = row.gaussian_count,
                         py::arg("seconds") = row.seconds));
  return py::dict(py::arg("model") = result.model,
                  py::arg("evaluation") =
                      result.evaluation ? figures_of(*result.evaluation) : py::object(py::none()),
                  py::arg("metrics") = rows, py::arg("steps") = result.steps,
                  py::arg("stopped_early") = result.stopped_early,
                  py::arg("seconds") = result.seconds, py::arg("device") = result.device,
                  py::arg("config") = result.config, py::arg("output") = result.output);
}

}  // namespace

Config config_of_run(const ScenePointer& scene, const std::string& config,
                     const FilledVerb& keywords, Config start) {
  apply_settings(start, Json::parse(config));
  keywords.apply_to(start);
  if (!start.dataset.source.empty()) start.dataset.source = absolute_path(start.dataset.source);
  if (scene) start.dataset = scene->dataset;
  validate(start);
  return start;
}

Evaluation evaluation_of(Trainer& trainer, Lpips* lpips) {
  return evaluate(trainer.backend().renderer(), trainer.model().gaussians.span(),
                  trainer.scene().test_views, trainer.evaluation_settings(), {},
                  evaluation_options(trainer, {true, lpips}));
}

void bind_train(py::module_& module) { module.def("train", train); }

}  // namespace gs::python
