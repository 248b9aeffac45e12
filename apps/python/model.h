// SPDX-License-Identifier: Apache-2.0
// gemsplat.Model: trained Gaussians as NumPy arrays.
#pragma once

#include <pybind11/pybind11.h>

#include <memory>

#include "gs_app/run/open_model.h"

namespace gs::python {

/// Gaussians in host memory, and the config to render them with. The number of Gaussians never
/// changes, so that NumPy arrays can be views of them.
using Model = OpenedModel;

/// The arguments of Model(). Of two forms, such as scales and log_scales, one is None. Shapes:
/// docs/reference/python.md.
struct ModelArrays {
  pybind11::object means, rotations, scales, log_scales, opacities, logit_opacities, colors, sh0,
      sh_rest;
};

/// Copies the arrays. Throws UsageError that names the array that cannot be used.
std::shared_ptr<Model> make_model(const ModelArrays& arrays, bool antialiased,
                                  const pybind11::object& world_offset);

/// A model with its own memory.
std::shared_ptr<Model> copy_of_model(const Model& model);

void bind_model(pybind11::module_& module);

}  // namespace gs::python
