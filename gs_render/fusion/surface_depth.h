// SPDX-License-Identifier: Apache-2.0
// The depth of the surface that a picture shows, for meshes. It is not the mean depth of
// surface_renderer.h, which lies between a surface and what floats in front of it.
#pragma once

#include "gs_core/camera.h"
#include "gs_core/gaussians.h"
#include "gs_core/image.h"
#include "gs_core/math/render/covariance.h"
#include "gs_core/math/render/filter_3d.h"
#include "gs_core/math/render/surface.h"
#include "gs_render/fusion/depth_picture.h"
#include "gs_render/render_pass.h"

namespace gs {

inline constexpr float kDepthWindow = 0.01f;  // of the inverse depth at the crossing
inline constexpr float kMostLight = 0.45f;    // that a surface lets through
inline constexpr float kOpenLight = 0.9f;     // more is left where nothing is

/// What a fragment has to say about the depth of its pixel: its weight in blending, times the square
/// of the light that reaches it. The front of a surface counts more so; the mean by weights alone lies
/// behind surfaces that are known (docs/lab/2026-11-meshes.md).
///
/// light   what is left behind the fragment
GS_HD float depth_share(float weight, float light) {
  const float reaches = light + weight;
  return weight * reaches * reaches;
}

/// The plane of a Gaussian without time, whose splat has this conic.
GS_HD SplatPlane<float> plane_of(const GaussiansSpan& gaussians, std::size_t i,
                                 const Camera& camera, const Sym2<float>& conic) {
  const Vec3f variances = filtered_variance(
      variance(gaussians.log_scale[i]), gaussians.has_filter ? gaussians.filter_scale[i] : 0.0f);
  return splat_plane(camera, to_camera(camera, gaussians.mean[i]),
                     covariance(rotation_matrix(gaussians.rotation[i]), variances), conic);
}

/// The inverse depth of each pixel's surface, 1 / world units, kUnknownDepth or kOpenPixel.
/// (height, width, 1)
///
///   o = sum s_i o_i / sum s_i   over the fragments with |o_i - o_c| <= kDepthWindow o_c
///
/// o_i is the inverse depth of fragment i on the plane of its splat (splat_plane()), s_i its
/// depth_share(), and c the fragment behind which less than half of the light is left. Fragments in
/// front of the surface and behind it thus do not move it.
///
/// pass       what forward() of the scalar renderer made of the Gaussians and the camera
/// gaussians  in host memory, without time
ImageF surface_inverse_depth(const RenderPass& pass, const GaussiansSpan& gaussians,
                             const Camera& camera, const RenderSettings& settings);

}  // namespace gs
