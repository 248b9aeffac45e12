// SPDX-License-Identifier: Apache-2.0
// gemsplat.Camera: an undistorted pinhole with a pose.
#pragma once

#include <pybind11/pybind11.h>

#include "data_loaders/cameras/camera_file.h"

namespace gs::python {

void bind_camera(pybind11::module_& module);

}  // namespace gs::python
