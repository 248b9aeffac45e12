// SPDX-License-Identifier: Apache-2.0
// Pictures of where things are instead of how they look: depth, coverage and normals, from any renderer.
#pragma once

#include <vector>

#include "gs_core/image.h"
#include "gs_render/renderer.h"

namespace gs {

/// 1 - T of each pixel of a pass: how much of it the Gaussians cover.   (height, width, 1), 0..1
ImageF alpha_of(const RenderPass& pass);

/// Blends the depth of each Gaussian in the place of its color, with the weights that its color would have, so that every
/// renderer can do it: a forward pass of its own. Keeps the Gaussians' span, which outlives it, and 12 bytes for each of
/// them on either side.
/// Throws Error where memory runs out.
class SurfaceRenderer {
 public:
  /// host       the same Gaussians in host memory; looked at in the constructor alone
  /// settings   as for the color; SH degree, background and tensor cores (11 bits of a color) make no difference
  SurfaceRenderer(Renderer& renderer, const GaussiansSpan& gaussians, const Gaussians& host,
                  const RenderSettings& settings);

  /// The mean depth of what a pixel shows: sum(w z) / sum(w) over its fragments, z the depth of a Gaussian's center along the
  /// viewing axis; 0 where it shows next to nothing (alpha below kMinAlpha).   (height, width, 1), world units
  ImageF depth(const Camera& camera);

 private:
  Renderer& renderer_;
  GaussiansSpan gaussians_;
  RenderSettings settings_;
  std::vector<Vec3f> means_;  // (N) world units
  Buffer<Vec3f> sh0_;         // (N) of the values
  RenderPass pass_;
};

/// The normals of the surface that a depth picture shows, in world space, of length 1, on the side of the camera: across the
/// differences between the points of the neighboring pixels, or of the pixel itself at a border; 0 0 0 where there is no
/// depth, or none beside it.   (height, width, 3)
ImageF normals_of(const ImageF& depth, const Camera& camera);

/// Normals in the frame of a camera: x right, y up, z towards it, as pictures of normals have them.
ImageF normals_in_camera(const ImageF& normals, const Camera& camera);

}  // namespace gs
