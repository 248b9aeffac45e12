// SPDX-License-Identifier: Apache-2.0
// gemsplat.Error and its kinds: what C++ throws as Error, in Python.
#pragma once

#include <pybind11/pybind11.h>

namespace gs::python {

/// Makes the exceptions Error, UsageError (also a ValueError) and OutOfMemoryError (also a
/// MemoryError). A gs::Error becomes one of them.
void bind_errors(pybind11::module_& module);

}  // namespace gs::python
