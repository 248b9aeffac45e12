// SPDX-License-Identifier: Apache-2.0
// gemsplat.Camera: an undistorted pinhole with a pose.
#pragma once

#include <pybind11/pybind11.h>

#include <vector>

#include "data_loaders/cameras/camera_file.h"

namespace gs::python {

/// The cameras of a list of Camera; none of None. Throws UsageError for anything else.
std::vector<NamedCamera> named_cameras_of(const pybind11::object& cameras);

void bind_camera(pybind11::module_& module);

}  // namespace gs::python
