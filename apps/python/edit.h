// SPDX-License-Identifier: Apache-2.0
// Model.edit, Model.keep, Model.drop and gemsplat.merge.
#pragma once

#include <memory>

#include "apps/python/model.h"

namespace gs::python {

void bind_edits(pybind11::module_& module, pybind11::class_<Model, std::shared_ptr<Model>>& model);

}  // namespace gs::python
