// SPDX-License-Identifier: Apache-2.0
// Measures how much of a model a lossy file has kept: renders both and compares the pictures.
#pragma once

#include <functional>
#include <vector>

#include "gs_core/camera.h"
#include "gs_model/formats/sidecar.h"
#include "gs_train/backend.h"

namespace gs {

/// Cameras and settings to compare a model with its file. Backend and Gaussians must outlive it.
struct Viewpoints {
  Backend& backend;
  GaussiansSpan original;  // in the backend's memory
  RenderSettings settings;
  std::vector<Camera> cameras;
  const char* what = "{} test views";  // with the number of views in the place of {}
  // The cameras that formats weigh Gaussians by; empty: there are none.
  std::function<std::vector<Camera>()> training = {};
};

/// Renders both from each camera. `kept` lies in the frame of the original; its SH degree may be
/// lower. Throws Error as the renderer does.
Fidelity fidelity_of(const GaussianModel& kept, const Viewpoints& viewpoints);

}  // namespace gs
