// SPDX-License-Identifier: Apache-2.0
// gemsplat.Model: trained Gaussians as NumPy arrays.
#pragma once

#include <pybind11/pybind11.h>

#include <memory>

#include "gs_api/open_model.h"

namespace gs::python {

/// Gaussians in host memory and the config that they are looked at with. The number of Gaussians never changes, so that
/// arrays may show them where they lie.
using Model = OpenedModel;

void bind_model(pybind11::module_& module);

}  // namespace gs::python
