// SPDX-License-Identifier: Apache-2.0
#include "apps/python/model.h"

#include <pybind11/stl.h>
#include <pybind11/stl/filesystem.h>
#include <spdlog/fmt/fmt.h>

#include <cmath>

#include "apps/python/arrays.h"
#include "apps/python/devices.h"
#include "apps/python/edit.h"
#include "apps/python/outputs.h"
#include "gs_app/run/open_model.h"
#include "gs_core/error.h"
#include "gs_core/math/constants.h"
#include "gs_core/math/render/activations.h"

namespace gs::python {
namespace {

using ModelPointer = std::shared_ptr<Model>;

// ---- to arrays ---------------------------------------------------------------------------------

py::object view_of(const py::object& self, const void* data, const Shape& shape,
                   const Shape& strides = {}) {
  return array_in(static_cast<const float*>(data), shape, strides, self, true);
}

Gaussians& gaussians_of(const py::object& self) { return self.cast<Model&>().model.gaussians; }

py::object sh_rest_view(const py::object& self) {
  const Model& model = self.cast<Model&>();
  const Gaussians& gaussians = model.model.gaussians;
  return view_of(self, gaussians.sh_rest.data(),
                 {py::ssize_t(gaussians.count()), sh_rest_count(model.model.sh_degree), 3},
                 {sizeof(ShRest), sizeof(Vec3f), sizeof(float)});
}

// A copy with f applied to each value.
template <class F>
FloatArray mapped(const void* data, const Shape& shape, F&& f) {
  FloatArray result(shape);
  const auto* const from = static_cast<const float*>(data);
  for (py::ssize_t i = 0; i < result.size(); ++i) result.mutable_data()[i] = f(from[i]);
  return result;
}

FloatArray unit_rotations(const Model& model) {
  const Gaussians& gaussians = model.model.gaussians;
  FloatArray result(Shape{py::ssize_t(gaussians.count()), 4});
  auto* const to = reinterpret_cast<Quatf*>(result.mutable_data());
  for (std::size_t i = 0; i < gaussians.count(); ++i) {
    const Quatf& q = gaussians.rotation[i];
    const float length = std::sqrt(squared_norm(q));
    to[i] = {q.w / length, q.x / length, q.y / length, q.z / length};
  }
  return result;
}

std::string description(const Model& model) {
  return fmt::format("<gemsplat.Model: {} Gaussians, SH degree {}{}>",
                     model.model.gaussians.count(), model.model.sh_degree,
                     model.model.antialiased ? ", antialiased" : "");
}

// ---- files -------------------------------------------------------------------------------------

ModelPointer load_model(const std::filesystem::path& path, std::optional<int> step) {
  const Work work;
  return std::make_shared<Model>(open_model(path, step));
}

std::size_t save(const Model& model, const std::filesystem::path& path, bool replace,
                 int spz_version, int spz_sh_bits) {
  ExportRequest request = export_request(path, replace, spz_version, spz_sh_bits);
  request.input_from_model = model.input_from_model;
  const Work work;
  return export_model(model.model, request).gaussians;
}

void bind_arrays(py::class_<Model, ModelPointer>& model) {
  const auto rows = [](const Gaussians& gaussians) { return py::ssize_t(gaussians.count()); };
  const auto view = [&](const char* name, auto member, int width, const char* meaning) {
    model.def_property_readonly(
        name,
        [=](const py::object& self) {
          const Gaussians& gaussians = gaussians_of(self);
          const Shape shape = width ? Shape{rows(gaussians), width} : Shape{rows(gaussians)};
          return view_of(self, (gaussians.*member).data(), shape);
        },
        meaning);
  };
  view("means", &Gaussians::mean, 3,
       "(N, 3) float32: centers, world units. A view: writing to it changes the model.");
  view("log_scales", &Gaussians::log_scale, 3,
       "(N, 3) float32: logarithms of the standard deviations along the axes, of world units. A "
       "view.");
  view("rotations", &Gaussians::rotation, 4,
       "(N, 4) float32: quaternions w x y z of any length above 0, from a Gaussian's axes to the "
       "world. A view.");
  view("logit_opacities", &Gaussians::logit_opacity, 0,
       "(N,) float32: opacity = 1 / (1 + exp(-x)). A view.");
  view("sh0", &Gaussians::sh0, 3,
       "(N, 3) float32: SH coefficients of degree 0, red green blue; color = 0.5 + 0.2820948 sh0. "
       "A view.");
  model.def_property_readonly(
      "sh_rest", sh_rest_view,
      "(N, K, 3) float32: SH coefficients of degrees 1 to sh_degree, K = (sh_degree + 1)^2 - 1, in "
      "the usual order. A view, not contiguous below degree 3.");
}

void bind_activated(py::class_<Model, ModelPointer>& model) {
  model.def_property_readonly(
      "scales",
      [](const Model& self) {
        const Gaussians& gaussians = self.model.gaussians;
        return mapped(gaussians.log_scale.data(), {py::ssize_t(gaussians.count()), 3},
                      [](float x) { return std::exp(x); });
      },
      "(N, 3) float32: standard deviations along the axes, world units. A copy.");
  model.def_property_readonly("unit_rotations", unit_rotations,
                              "(N, 4) float32: rotations with length 1, w x y z. A copy.");
  model.def_property_readonly(
      "opacities",
      [](const Model& self) {
        const Gaussians& gaussians = self.model.gaussians;
        return mapped(gaussians.logit_opacity.data(), {py::ssize_t(gaussians.count())},
                      [](float x) { return sigmoid(x); });
      },
      "(N,) float32: 0 to 1. A copy.");
  model.def_property_readonly(
      "colors",
      [](const Model& self) {
        const Gaussians& gaussians = self.model.gaussians;
        return mapped(gaussians.sh0.data(), {py::ssize_t(gaussians.count()), 3},
                      [](float x) { return float(kColorOffset) + float(kSh0) * x; });
      },
      "(N, 3) float32: colors of degree 0, red green blue, 0 to 1 as displayed (sRGB), not "
      "clamped. A copy.");
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
  py::class_<Model, ModelPointer> model(
      module, "Model",
      R"(N trained Gaussians in host memory. Arrays of stored values are views of the model's memory: they
keep it alive, and writing to them changes the model. Do not write while another thread renders
the model.)");
  model.def(
      py::init([](py::object means, py::object rotations, py::object scales, py::object log_scales,
                  py::object opacities, py::object logit_opacities, py::object colors,
                  py::object sh0, py::object sh_rest, bool antialiased, py::object world_offset) {
        return make_model({means, rotations, scales, log_scales, opacities, logit_opacities, colors,
                           sh0, sh_rest},
                          antialiased, world_offset);
      }),
      R"(Copies arrays of real numbers to float32. The shapes are those of the properties. Give scales
or log_scales, opacities or logit_opacities, colors or sh0. Without sh_rest the SH degree is 0. NaN and infinity are refused (UsageError).)",
      py::kw_only(), py::arg("means"), py::arg("rotations"), py::arg("scales") = py::none(),
      py::arg("log_scales") = py::none(), py::arg("opacities") = py::none(),
      py::arg("logit_opacities") = py::none(), py::arg("colors") = py::none(),
      py::arg("sh0") = py::none(), py::arg("sh_rest") = py::none(), py::arg("antialiased") = false,
      py::arg("world_offset") = py::none());
  bind_arrays(model);
  bind_activated(model);
  model.def("__len__", [](const Model& self) { return self.model.gaussians.count(); });
  model.def("__repr__", description);
  model.def("copy", copy_of_model, py::call_guard<py::gil_scoped_release>(),
            "A model with its own memory.");
  model.def(
      "save", save, py::call_guard<py::gil_scoped_release>(), py::arg("path"), py::kw_only(),
      py::arg("replace") = false, py::arg("spz_version") = 3, py::arg("spz_sh_bits") = 0,
      R"(Writes a file of the format that the name ends in (ply, glb, compressed.ply, spz, sog,
rad, splat), whole or not at all, and returns the number of Gaussians in it: rows with NaN or infinity
are left out, with a warning. A file beside it, NAME.transforms.json, has what the format cannot say.
A file that is there already is refused (UsageError), or with replace=True kept as NAME.bak-N.)");
  model.def_property_readonly(
      "sh_degree", [](const Model& self) { return self.model.sh_degree; }, "0 to 3.");
  model.def_property_readonly(
      "antialiased", [](const Model& self) { return self.model.antialiased; },
      "Whether it was trained, and is rendered, with the antialiased projection.");
  model.def_property_readonly(
      "world_offset",
      [](const Model& self) {
        const Vec3d& offset = self.model.world_offset;
        return py::make_tuple(offset.x, offset.y, offset.z);
      },
      "Three floats: add them to the means to get the photos' own coordinates; 0 for most scenes.");
  bind_edits(module, model);
  module.def("load", load_model, py::call_guard<py::gil_scoped_release>(), py::arg("path"),
             py::arg("step") = py::none(),
             R"(Reads the model of a file (ply, glb, compressed.ply, spz, sog, rad, splat,
gs4d), of a folder of SOG files, or of a run's folder: the newest one, or that after `step`. Values stay as they are in the file, also NaN and infinity.)");
}

}  // namespace gs::python
