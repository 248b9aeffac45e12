// SPDX-License-Identifier: Apache-2.0
// How much of a model a lossy format has kept: pictures of both, compared.
#pragma once

#include <vector>

#include "gs_core/camera.h"
#include "gs_train/backend.h"

namespace gs {

/// Means over views, of the picture of what was kept against that of the original, both in 8 bits.
struct Fidelity {
  double psnr = 0, ssim = 0;  // psnr in dB, 100 where no pixel differs
  std::size_t num_views = 0;
};

/// Where the original is looked at from, and how. Backend and Gaussians outlive it.
struct Viewpoints {
  Backend& backend;
  GaussiansSpan original;  // in the backend's memory
  RenderSettings settings;
  std::vector<Camera> cameras;
  const char* what = "test";  // views
};

/// Renders both from each camera. `kept` lies in the frame of the original; its SH degree may be lower. Throws Error as the renderer does.
Fidelity fidelity_of(const GaussianModel& kept, const Viewpoints& viewpoints);

}  // namespace gs
