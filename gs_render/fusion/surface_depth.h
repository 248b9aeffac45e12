// SPDX-License-Identifier: Apache-2.0
// The depth of the surface that a picture shows, for meshes. It is not the mean depth of
// surface_renderer.h, which lies between a surface and what floats in front of it.
#pragma once

#include "gs_core/camera.h"
#include "gs_core/gaussians.h"
#include "gs_core/image.h"
#include "gs_render/render_pass.h"

namespace gs {

/// What an inverse depth says of a pixel that shows no surface: a positive value is that of one.
inline constexpr float kUnknownDepth = 0;  // Gaussians cover the pixel in part
inline constexpr float kOpenPixel = -1;    // nothing is there

/// The inverse depth of each pixel's surface, 1 / world units, or one of the two values above.
/// (height, width, 1)
///
///   o = sum w o_i / sum w   over the fragments with |o_i - o_c| <= kDepthWindow o_c
///
/// o_i is the inverse depth of fragment i on the plane of its splat (splat_plane()), w its weight
/// in blending, and c the fragment behind which less than half of the light is left. Fragments in
/// front of the surface and behind it thus do not move it.
///
/// pass       what Renderer::forward() of any renderer made of the Gaussians and the camera
/// gaussians  in host memory, without time
ImageF surface_inverse_depth(const RenderPass& pass, const Gaussians& gaussians,
                             const Camera& camera, const RenderSettings& settings);

}  // namespace gs
