// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "cuda/stages.cuh"
#include "gs_core/math/render/surface.h"

namespace gs::cuda {

/// After 4  surface_depth.cu: the depth of each pixel's surface, twin of surface_inverse_depth().
/// `pass` is that of a forward pass for a backward pass.
///
/// planes         scratch
/// inverse_depth  (H, W)  1 / world units, kUnknownDepth or kOpenPixel
void find_surface_depth(Context& context, const GaussiansSpan& gaussians, const Camera& camera,
                        const RenderSettings& settings, const RenderPass& pass,
                        Buffer<SplatPlane<float>>& planes, float* inverse_depth);

}  // namespace gs::cuda
