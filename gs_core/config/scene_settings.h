// SPDX-License-Identifier: Apache-2.0
// Settings whose numbers follow from the scene: the defaults, which fit any scene, say "so many
// passes over the photos" and "so many Gaussians for each sparse point".
#pragma once

#include <cstddef>

#include "gs_core/config/config.h"

namespace gs {

struct Scene;

/// What settings follow from.
struct SceneNumbers {
  std::size_t points = 0;          // sparse ones
  std::size_t photos = 0;          // to train on
  double pixels = 0;               // of these photos together
  std::size_t points_outside = 0;  // of density.region, where Gaussians do not grow
};

/// The config with numbers for such a scene:
///
///   train.iterations       if it is 0: train.epochs passes over the photos, at least
///                          train.least_iterations and at most train.most_iterations steps; all
///                          three are train.random_start_factor times as large where there are no
///                          points and no model to start from
///   density.max_gaussians  if it is 0 and density.gaussians_per_point is not: that many for each
///                          point (of model.random_points in a scene without points), but in a
///                          scene with points at least one for density.pixels_per_gaussian pixels;
///                          at most 10 million or the number of points, whichever is larger. Points
///                          outside of density.region count once, and photos of a scene with such
///                          points in proportion to the others
///
/// Settings that have numbers already stay as they are.
Config resolved_config(Config config, const SceneNumbers& scene);
Config resolved_config(Config config, const Scene& scene);

/// The config of a run that goes on: the run keeps the numbers that it began with, and the settings
/// that they followed from.
Config settled_as_in(const Config& run, Config now);

}  // namespace gs
