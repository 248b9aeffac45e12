// SPDX-License-Identifier: Apache-2.0
// How well the normals of Gaussians are those of the surface that their depths show.
#pragma once

#include <vector>

#include "gs_core/scene.h"
#include "gs_eval/metrics.h"
#include "gs_render/renderer.h"

namespace gs {

/// Renders the surfaces of views, and adds the mean angle between blended normals and those of the
/// mean depths to their evaluation: over the pixels that show one surface (math/surface_loss.h), in
/// degrees. Does nothing for Gaussians in space and time, and leaves out cameras with a lens.
void measure_normals(Renderer& renderer, const Gaussians& gaussians, const std::vector<View>& views,
                     const RenderSettings& settings, Evaluation& evaluation);

}  // namespace gs
