// SPDX-License-Identifier: Apache-2.0
// gemsplat.train(): a training run, in memory or into a run's folder, watched from Python.
#pragma once

#include <pybind11/pybind11.h>

namespace gs::python {

void bind_train(pybind11::module_& module);

}  // namespace gs::python
