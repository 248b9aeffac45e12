// SPDX-License-Identifier: Apache-2.0
#include <pybind11/stl.h>
#include <spdlog/fmt/fmt.h>

#include <algorithm>
#include <filesystem>

#include "apps/python/arrays.h"
#include "apps/python/devices.h"
#include "apps/python/module.h"
#include "data_loaders/cameras/camera_file.h"
#include "gs_app/edit/edit_cameras.h"
#include "gs_app/edit/edit_step.h"
#include "gs_app/jobs/keywords.h"
#include "gs_core/error.h"
#include "gs_model/edit/merge_models.h"
#include "gs_model/edit/places/words.h"

namespace gs::python {
namespace {

EditModel edit_model_of(const Model& model) {
  return {std::move(copy_of_model(model)->model), model.input_from_model, {}};
}

// A model with what `like` says of its origin and settings.
ModelPointer model_of(EditModel edited, const Model& like) {
  auto result = std::make_shared<Model>();
  result->ply = like.ply;
  result->run = like.run;
  result->config = like.config;
  result->config.model.sh_degree = edited.model.sh_degree;
  result->config.render.antialias = edited.model.antialiased;
  result->model = std::move(edited.model);
  result->input_from_model = edited.input_from_model;
  return result;
}

// "keep opacity=0.1.." as the operation and its value.
EditStep step_of(const std::string& text, const EditOptions& options) {
  const std::size_t space = text.find(' ');
  return edit_step(text.substr(0, space), space == text.npos ? "" : text.substr(space + 1),
                   options);
}

// The cameras that are given, or where a step wants some, those of the model's run.
std::vector<EditCamera> cameras_for(const std::vector<EditStep>& steps, const Model& model,
                                    const EditModel& edited,
                                    const std::vector<NamedCamera>& given) {
  std::vector<EditCamera> cameras;
  for (const NamedCamera& camera : given) cameras.push_back({camera.name, camera.camera});
  const bool wants = std::any_of(steps.begin(), steps.end(), [](const EditStep& step) {
    return step.needs_cameras || step.likes_cameras;
  });
  const bool has_run = model.run && std::filesystem::exists(model.run->cameras());
  return given.empty() && wants && has_run ? cameras_to_edit(*model.run, edited) : cameras;
}

ModelPointer edit(const Model& model, const std::vector<std::string>& operations,
                  const std::vector<NamedCamera>& cameras, const std::string& values) {
  const FilledVerb keywords("edit", Json::parse(values));
  const auto about = numbers_of_list(keywords.get<std::string>("--about"), 3, "about");
  const EditOptions options{
      {about[0], about[1], about[2]},
      {polygon_plane(keywords.get<std::string>("--plane")), keywords.get<bool>("--whole")},
      keywords.get<std::string>("--decimate-by") == "merge"};
  std::vector<EditStep> steps;
  for (const std::string& operation : operations) steps.push_back(step_of(operation, options));
  const py::gil_scoped_release release;
  const Work work;
  std::optional<BorrowedBackend> backend;  // where something is rendered
  EditSession session{edit_model_of(model), {}};
  session.model.cameras = cameras_for(steps, model, session.model, cameras);
  session.tools = {[&]() -> Backend& {
                     if (!backend) backend.emplace(keywords.device());
                     return **backend;
                   },
                   view_settings(model, model.config), false};
  for (const EditStep& step : steps) apply_step(session, step);
  return model_of(std::move(session.model), model);
}

// Keeps what is marked, by one mark for each Gaussian.
ModelPointer keep(const Model& model, const py::array_t<bool, py::array::c_style>& rows) {
  const Marks marks(rows.data(), rows.data() + rows.size());
  const py::gil_scoped_release release;
  const Work work;
  EditModel result = edit_model_of(model);
  keep_rows(result, rows_marked(marks, true));
  return model_of(std::move(result), model);
}

ModelPointer merge(const std::vector<ModelPointer>& models, bool as_stored,
                   std::optional<bool> antialiased) {
  if (models.empty()) throw UsageError("merge needs one model at least");
  const Work work;
  std::vector<NamedModel> named;
  for (const ModelPointer& model : models) {
    const std::string name =
        model->ply.empty() ? fmt::format("model {}", named.size() + 1) : model->ply.string();
    named.push_back({name, edit_model_of(*model)});
  }
  return model_of(merge_models(std::move(named), {as_stored, antialiased}), *models.front());
}

}  // namespace

void bind_edit(py::module_& module) {
  module.def("edit", edit);
  module.def("keep", keep);
  module.def("merge", merge, py::call_guard<py::gil_scoped_release>());
}

}  // namespace gs::python
