// SPDX-License-Identifier: Apache-2.0
#include "apps/python/edit.h"

#include <pybind11/stl.h>
#include <spdlog/fmt/fmt.h>

#include <algorithm>
#include <filesystem>

#include "apps/python/arrays.h"
#include "apps/python/camera.h"
#include "apps/python/devices.h"
#include "gs_app/edit/edit_cameras.h"
#include "gs_app/edit/edit_step.h"
#include "gs_core/error.h"
#include "gs_model/edit/merge_models.h"

namespace gs::python {
namespace {

using ModelPointer = std::shared_ptr<Model>;

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

EditOptions options_of(const py::object& about, const std::string& plane, bool whole,
                       const std::string& decimate_by) {
  if (decimate_by != "merge" && decimate_by != "drop")
    throw UsageError("decimate_by must be merge or drop, and is " + decimate_by);
  return {about.is_none() ? Vec3d(0.0) : vector_of("about", about),
          {polygon_plane(plane), whole},
          decimate_by == "merge"};
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

ModelPointer edited(const Model& model, const std::vector<EditStep>& steps,
                    const std::vector<NamedCamera>& cameras, const std::string& device) {
  const Work work;
  std::optional<BorrowedBackend> backend;  // where something is rendered
  EditSession session{edit_model_of(model), {}};
  session.model.cameras = cameras_for(steps, model, session.model, cameras);
  session.tools = {[&]() -> Backend& {
                     if (!backend) backend.emplace(device);
                     return **backend;
                   },
                   view_settings(model, model.config), false};
  for (const EditStep& step : steps) apply_step(session, step);
  return model_of(std::move(session.model), model);
}

ModelPointer edit(const Model& model, const py::args& operations, const py::object& cameras,
                  const py::object& about, const std::string& plane, bool whole,
                  const std::string& decimate_by, const std::string& device) {
  const EditOptions options = options_of(about, plane, whole, decimate_by);
  std::vector<EditStep> steps;
  for (const py::handle& operation : operations) {
    if (!py::isinstance<py::str>(operation))
      throw UsageError(
          "operations are words, such as \"keep opacity=0.1..\"; rows of an array are "
          "kept with Model.keep");
    steps.push_back(step_of(operation.cast<std::string>(), options));
  }
  const std::vector<NamedCamera> given = named_cameras_of(cameras);
  const py::gil_scoped_release release;
  return edited(model, steps, given, device);
}

// Keeps the rows where the array is `value`.
ModelPointer chosen(const Model& model, const py::object& given, bool value) {
  const py::array rows = py::array::ensure(given);
  const auto count = py::ssize_t(model.model.gaussians.count());
  if (!rows || !py::isinstance<py::array_t<bool>>(rows) || rows.ndim() != 1 ||
      rows.shape(0) != count)
    throw UsageError(
        fmt::format("rows must be an array of {} booleans, one for each Gaussian, such as "
                    "model.opacities > 0.1",
                    count));
  const auto marked = py::array_t<bool, py::array::c_style | py::array::forcecast>(rows);
  const Marks marks(marked.data(), marked.data() + count);
  const py::gil_scoped_release release;
  const Work work;
  EditModel result = edit_model_of(model);
  keep_rows(result, rows_marked(marks, value));
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

void bind_edits(py::module_& module, py::class_<Model, ModelPointer>& model) {
  model.def(
      "edit", edit, py::kw_only(), py::arg("cameras") = py::none(), py::arg("about") = py::none(),
      py::arg("plane") = "xz", py::arg("whole") = false, py::arg("decimate_by") = "merge",
      py::arg("device") = "auto",
      R"(A new model after operations, in their order. They are those of `gemsplat edit`, in the same words
without dashes: model.edit("drop opacity=..0.05", "straighten", "decimate 0.5").
docs/reference/edit.md
lists them.

cameras: a list of Camera in the model's coordinates, all of which count as training views; by
default those of the run from which the model was loaded.
about: the point that turn, scale and up leave where it is. plane: that of polygons. whole: all of
a Gaussian has to be in a place, and not its mean alone. decimate_by: merge or drop. device: where contributions are rendered.)");
  model.def(
      "keep", [](const Model& self, const py::object& rows) { return chosen(self, rows, true); },
      py::arg("rows"),
      "A new model of the Gaussians where `rows`, an array of N booleans, is True.");
  model.def(
      "drop", [](const Model& self, const py::object& rows) { return chosen(self, rows, false); },
      py::arg("rows"),
      "A new model of the Gaussians where `rows`, an array of N booleans, is False.");
  module.def(
      "merge", merge, py::call_guard<py::gil_scoped_release>(), py::arg("models"), py::kw_only(),
      py::arg("as_stored") = false, py::arg("antialiased") = py::none(),
      R"(A new model of all Gaussians of several models, in the frame of the first. Each one is brought there
by way of the photos' frame; as_stored=True takes the numbers as they are. antialiased: whether the
result is, where the models do not agree.)");
}

}  // namespace gs::python
