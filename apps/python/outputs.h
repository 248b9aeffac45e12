// SPDX-License-Identifier: Apache-2.0
// gemsplat.export() and gemsplat.report().
#pragma once

#include <pybind11/pybind11.h>

namespace gs::python {

void bind_outputs(pybind11::module_& module);

}  // namespace gs::python
