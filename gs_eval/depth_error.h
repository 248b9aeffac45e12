// SPDX-License-Identifier: Apache-2.0
// How far the depth of a model is from the depth maps of views.
#pragma once

#include <optional>

#include "gs_core/image.h"
#include "gs_core/scene.h"
#include "gs_eval/metrics.h"
#include "gs_render/renderer.h"

namespace gs {

/// The mean of |D - M| / M over the pixels that the view's map knows, weighted by its mask, where D
/// is the rendered depth (0 where nothing is drawn, which has the error 1) and M that of the map.
/// Scale and shift of a map without units are fitted to D first, as in training. None for a view
/// without a map, and where the map says nothing.
///
/// depth  (height, width, 1) as SurfaceRenderer::depth() gives it, world units
std::optional<double> depth_error(const ImageF& depth, const View& view);

/// Renders the depth of each view that has a map and was measured, and adds the errors to the
/// evaluation of these views. Does nothing for Gaussians in space and time.
void measure_depth(Renderer& renderer, const Gaussians& gaussians, const std::vector<View>& views,
                   const RenderSettings& settings, Evaluation& evaluation);

}  // namespace gs
