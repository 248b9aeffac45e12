// SPDX-License-Identifier: Apache-2.0
// The parts of the module gemsplat._gemsplat, and what its classes hold.
#pragma once

#include <pybind11/pybind11.h>

#include <memory>

#include "gs_app/run/open_model.h"
#include "gs_eval/metrics.h"
#include "gs_render/footprint.h"

namespace gs::python {

/// gemsplat.Model: Gaussians in host memory, and the config to render them with. The number of
/// Gaussians never changes, so that NumPy arrays can be views of them.
using Model = OpenedModel;
using ModelPointer = std::shared_ptr<Model>;
/// A model with its own memory.
ModelPointer copy_of_model(const Model& model);

/// gemsplat.Scene, const once made, and shared: views and arrays of it keep it alive.
struct LoadedScene {
  Scene scene;
  DatasetConfig dataset;  // that it was loaded with
};
// pybind11 2.10 holds no shared_ptr to const: nothing writes by way of it.
using ScenePointer = std::shared_ptr<LoadedScene>;
/// Throws as load_scene() does. Call it without the GIL.
ScenePointer load(const Config& config);

/// gemsplat.Evaluation: (psnr, ssim, flip, lpips, [(name, psnr, ssim, flip, lpips) of a view, ...]).
pybind11::tuple figures_of(const Evaluation& evaluation);

/// shape: square or box.
FootprintRule footprint_rule(const std::string& shape, float clip, int tile);

/// gemsplat.Error and its kinds, and how errors of C++ become them.
void bind_errors(pybind11::module_& module);
void bind_model(pybind11::module_& module);
void bind_camera(pybind11::module_& module);
void bind_scene(pybind11::module_& module);
void bind_render(pybind11::module_& module);
void bind_exact(pybind11::module_& module);
void bind_points(pybind11::module_& module);
void bind_gpu_operator(pybind11::module_& module);
void bind_jax(pybind11::module_& module);
void bind_progress(pybind11::module_& module);
void bind_train(pybind11::module_& module);
void bind_trainer(pybind11::module_& module);
void bind_edit(pybind11::module_& module);
void bind_jobs(pybind11::module_& module);

}  // namespace gs::python
