// SPDX-License-Identifier: Apache-2.0
// gemsplat.render() and gemsplat.evaluate().
#pragma once

#include <pybind11/pybind11.h>

namespace gs::python {

void bind_render(pybind11::module_& module);

}  // namespace gs::python
