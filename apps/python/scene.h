// SPDX-License-Identifier: Apache-2.0
// gemsplat.Scene: posed photos and points, loaded from a folder or given as arrays.
#pragma once

#include <pybind11/pybind11.h>

#include <filesystem>
#include <memory>

#include "gs_core/config/config.h"
#include "gs_core/scene.h"

namespace gs::python {

/// Const once made, and shared: views and arrays of it keep it alive.
struct LoadedScene {
  Scene scene;
  DatasetConfig dataset;  // that it was loaded with
};
using ScenePointer = std::shared_ptr<const LoadedScene>;

/// Throws as load_scene() does; without the GIL.
ScenePointer load(const DatasetConfig& dataset);

void bind_scene(pybind11::module_& module);

}  // namespace gs::python
