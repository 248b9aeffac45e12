// SPDX-License-Identifier: Apache-2.0
// model.sky: what photos show behind all sparse points, as points on a sphere around the scene.
#pragma once

#include <vector>

#include "gs_core/config/config.h"
#include "gs_core/scene.h"

namespace gs {

/// Points on a sphere around the training cameras. All have the same distance from their neighbors.
struct Sky {
  std::vector<ScenePoint> points;
  float spacing = 0;  // between neighbors; world units
};

/// Even directions, of which those are kept in which the photos agree on a color and have no sparse
/// point nearby. Decodes up to 256 photos. Empty if model.sky is none, or if the scene has no
/// sparse points to tell what is near. Throws UsageError if the points of the sky would be more
/// than half of density.max_gaussians.
Sky sky_of(const Scene& scene, const Config& config);

}  // namespace gs
