// SPDX-License-Identifier: Apache-2.0
// The Gaussians that training starts from.
#pragma once

#include "gs_core/config/config.h"
#include "gs_core/scene.h"
#include "gs_train/training_model.h"

namespace gs {

/// One isotropic Gaussian per sparse point. It has the point's color, the configured opacity, and
/// as its scale the root mean squared distance to the three nearest neighbors (Kerbl et al. 2023,
/// Sec. 5.1), times model.initial_scale. A scene without points starts from random ones that at
/// least one training camera sees. Of more points than kMostPoints or density.max_gaussians
/// allows, a sample is taken (downsample_points.h). With model.dynamic each point gets a random time
/// (Yang et al. 2024). Throws Error where there are no points.
TrainingModel initial_model(const Scene& scene, const Config& config, Memory& memory);

}  // namespace gs
