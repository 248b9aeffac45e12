// SPDX-License-Identifier: Apache-2.0
// gemsplat.train(): a run of the trainer, watched from Python.
#pragma once

#include <pybind11/pybind11.h>

namespace gs::python {

void bind_train(pybind11::module_& module);

}  // namespace gs::python
