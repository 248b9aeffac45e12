// SPDX-License-Identifier: Apache-2.0
// Settings whose numbers follow from the scene: a preset for any scene says "so many passes over
// the photos" and "so many Gaussians for each sparse point".
#pragma once

#include "gs_core/config/config.h"
#include "gs_core/scene.h"

namespace gs {

/// The config with numbers in place of these settings, which are 0 in the result:
///
///   train.epochs                 train.iterations becomes that many passes over the training
///                                photos, from train.least_iterations to train.iterations steps
///   density.gaussians_per_point  density.max_gaussians becomes that many for each point that
///                                training starts from, unless a limit is given; points outside of
///                                density.region, where Gaussians do not grow, count once
///
/// A config without them stays as it is.
Config settled_for(Config config, const Scene& scene);

/// The config of a run that goes on. Where `now` has settings that follow from the scene, the run
/// keeps the numbers that it began with.
Config settled_as_in(const Config& run, Config now);

}  // namespace gs
