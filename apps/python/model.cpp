// SPDX-License-Identifier: Apache-2.0
// gemsplat.Model: trained Gaussians as NumPy arrays, and files of them.
#include <pybind11/stl.h>
#include <pybind11/stl/filesystem.h>
#include <spdlog/fmt/fmt.h>

#include <array>
#include <cmath>

#include "apps/python/arrays.h"
#include "apps/python/devices.h"
#include "apps/python/module.h"
#include "data_loaders/cameras/camera_file.h"
#include "gs_app/export/export_model.h"
#include "gs_app/jobs/keywords.h"
#include "gs_core/error.h"
#include "gs_core/math/constants.h"
#include "gs_core/math/render/activations.h"
#include "gs_core/math/render/rotation.h"

namespace gs::python {
namespace {

// Of arrays whose shapes fit. Rows of `sh_rest` have the coefficients of its degree.
ModelPointer make_model(const FloatArray& means, const FloatArray& rotations,
                        const FloatArray& log_scales, const FloatArray& logit_opacities,
                        const FloatArray& sh0, const FloatArray& sh_rest, bool antialiased,
                        const std::array<double, 3>& world_offset) {
  auto model = std::make_shared<Model>();
  Gaussians& gaussians = model->model.gaussians;
  gaussians.resize(std::size_t(means.shape(0)));
  copy_rows(means, gaussians.mean);
  copy_rows(rotations, gaussians.rotation);
  copy_rows(log_scales, gaussians.log_scale);
  copy_rows(logit_opacities, gaussians.logit_opacity);
  copy_rows(sh0, gaussians.sh0);
  gaussians.sh_rest.fill_zero();
  const std::size_t row = std::size_t(sh_rest.shape(1)) * sizeof(Vec3f);
  for (std::size_t i = 0; i < gaussians.count(); ++i) {
    if (is_degenerate(gaussians.rotation[i]))
      throw UsageError(fmt::format("rotations holds a quaternion of length 0 in row {}", i));
    if (row) std::memcpy(gaussians.sh_rest.data() + i, sh_rest.data(py::ssize_t(i), 0, 0), row);
  }
  model->model.sh_degree = sh_degree_with(sh_rest.shape(1)).value();
  model->model.antialiased = model->config.render.antialias = antialiased;
  model->config.model.sh_degree = model->model.sh_degree;
  model->model.world_offset = {world_offset[0], world_offset[1], world_offset[2]};
  return model;
}

FloatArray view_of(const py::object& self, const void* data, const Shape& shape,
                   const Shape& strides = {}) {
  return array_in(static_cast<const float*>(data), shape, strides, self, true);
}

FloatArray sh_rest_view(const py::object& self) {
  const GaussianModel& model = self.cast<Model&>().model;
  return view_of(self, model.gaussians.sh_rest.data(),
                 {py::ssize_t(model.gaussians.count()), sh_rest_count(model.sh_degree), 3},
                 {sizeof(ShRest), sizeof(Vec3f), sizeof(float)});
}

// Writes the file, and renders original and copy from the cameras, if there are any. Returns (file,
// format, gaussians, bytes, psnr, ssim).
py::tuple export_file(const Model& model, const std::filesystem::path& path,
                      const std::vector<NamedCamera>& cameras, bool replace,
                      const std::string& values) {
  const FilledVerb keywords("export", Json::parse(values));
  ExportRequest request{path, {}};
  request.options = {keywords.get<int>("--spz-version"), keywords.get<int>("--spz-sh-bits"),
                     keywords.get<double>("--duration")};
  request.input_from_model = model.input_from_model;
  const auto written = [&] {
    const py::gil_scoped_release release;
    check_export(request, replace, "give replace=True");
    const Work work;
    if (cameras.empty()) return export_model(model.model, request, nullptr);
    const BorrowedBackend backend(keywords.device());
    const Gaussians there = copy_to(backend->memory(), model.model);
    Viewpoints seen{*backend, there.span(), view_settings(model, model.config), {}};
    for (const NamedCamera& named : cameras) seen.cameras.push_back(named.camera);
    return export_model(model.model, request, &seen);
  }();
  const auto& loss = written.fidelity;
  return py::make_tuple(written.file, std::string(written.format->name), written.gaussians,
                        written.bytes, loss ? py::cast(loss->psnr) : py::none(),
                        loss ? py::cast(loss->ssim) : py::none());
}

}  // namespace

ModelPointer copy_of_model(const Model& from) {
  auto model = std::make_shared<Model>();
  model->ply = from.ply;
  model->run = from.run;
  model->config = from.config;
  model->input_from_model = from.input_from_model;
  model->model = host_copy(from.model.gaussians, from.model.sh_degree, from.model.antialiased);
  model->model.is_ours = from.model.is_ours;
  model->model.world_offset = from.model.world_offset;
  return model;
}

void bind_model(py::module_& module) {
  const py::call_guard<py::gil_scoped_release> without_gil;
  py::class_<Model, ModelPointer> model(
      module, "Model",
      R"(N trained Gaussians in host memory. Arrays of stored values are views of the model's memory: they
keep it alive, and writing to them changes the model. Do not write while another thread renders
the model.)");
  const auto view = [&](const char* name, auto member, int width, const char* meaning) {
    model.def_property_readonly(
        name,
        [=](const py::object& self) {
          const Gaussians& gaussians = self.cast<Model&>().model.gaussians;
          const auto rows = py::ssize_t(gaussians.count());
          return view_of(self, (gaussians.*member).data(),
                         width ? Shape{rows, width} : Shape{rows});
        },
        meaning);
  };
  model.def(py::init(&make_model));
  view("means", &Gaussians::mean, 3,
       "(N, 3) float32: centers, world units. A view: writing to it changes the model.");
  view("log_scales", &Gaussians::log_scale, 3,
       "(N, 3) float32: logarithms of the standard deviations, of world units. A view.");
  view("rotations", &Gaussians::rotation, 4,
       "(N, 4) float32: quaternions w x y z of any length above 0, from a Gaussian's axes to the "
       "world. A view.");
  view("logit_opacities", &Gaussians::logit_opacity, 0,
       "(N,) float32: opacity = 1 / (1 + exp(-x)). A view.");
  view("sh0", &Gaussians::sh0, 3,
       "(N, 3) float32: SH of degree 0, red green blue; color = 0.5 + 0.2820948 sh0. A view.");
  model.def_property_readonly(
      "sh_rest", sh_rest_view,
      "(N, K, 3) float32: SH coefficients of degrees 1 to sh_degree, K = (sh_degree + 1)^2 - 1, in "
      "the usual order. A view, not contiguous below degree 3.");
  model.def("__len__", [](const Model& self) { return self.model.gaussians.count(); });
  model.def("__repr__", [](const Model& self) {
    return fmt::format("<gemsplat.Model: {} Gaussians, SH degree {}{}>",
                       self.model.gaussians.count(), self.model.sh_degree,
                       self.model.antialiased ? ", antialiased" : "");
  });
  model.def("copy", copy_of_model, without_gil, "A model with its own memory.");
  model.def_property_readonly(
      "sh_degree", [](const Model& self) { return self.model.sh_degree; }, "0 to 3.");
  model.def_property_readonly(
      "antialiased", [](const Model& self) { return self.model.antialiased; },
      "Whether it was trained, and is rendered, with the antialiased projection.");
  model.def_property_readonly(
      "world_offset", [](const Model& self) { return three_of(self.model.world_offset); },
      "Three floats: add them to the means to get the photos' own coordinates; 0 for most scenes.");
  module.def(
      "load",
      [](const std::filesystem::path& path, std::optional<int> step) {
        const Work work;
        return std::make_shared<Model>(open_model(path, step));
      },
      without_gil);
  module.def("export", export_file);
  module.attr("SH0") = py::module_::import("numpy").attr("float32")(kSh0);
  module.def("exp", py::vectorize([](float x) { return std::exp(x); }));
  module.def("log", py::vectorize([](float x) { return std::log(x); }));
  module.def("sigmoid", py::vectorize([](float x) { return sigmoid(x); }));
  module.def("logit", py::vectorize([](float x) { return logit(x); }));
}

}  // namespace gs::python
