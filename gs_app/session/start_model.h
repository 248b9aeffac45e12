// SPDX-License-Identifier: Apache-2.0
// A run that starts from trained Gaussians instead of the scene's points (model.start_from): to
// fine-tune the model of any trainer, or to train on after a prune.
#pragma once

#include "gs_core/config/config.h"
#include "gs_core/scene.h"
#include "gs_train/loop/checkpoint.h"

namespace gs {

/// The state before step 1 with the Gaussians of model.start_from, a file of any format that is
/// read or a run's folder. The model of a run is turned, moved and scaled if the cameras of its
/// photos stand elsewhere in the scene (align_start.h). Adam's moments and the statistics of density
/// control are zero. Spherical harmonics are trained from the first step on up to the degree that
/// the file holds; higher ones follow as train.sh_degree_every says. A file of a higher degree than
/// model.sh_degree loses the coefficients above it. With model.filter_3d, a PLY with a column
/// filter_3D and a run that has one give their scales and opacities before the filter. Throws Error
/// where the file cannot be read or holds no Gaussian, UsageError where it holds Gaussians in space
/// and time and model.dynamic is off, or the reverse, and where the cameras cannot be made to
/// coincide.
TrainingState state_from_model(const Config& config, const Scene& scene);

}  // namespace gs
