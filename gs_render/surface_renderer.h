// SPDX-License-Identifier: Apache-2.0
// Pictures of geometry instead of color: depth, coverage and normals, with any renderer.
#pragma once

#include <vector>

#include "gs_core/image.h"
#include "gs_render/renderer.h"

namespace gs {

/// 1 - T of each pixel of a pass: the share of it that Gaussians cover.   (height, width, 1), 0..1
ImageF alpha_of(const RenderPass& pass);

/// Blends the depth of each Gaussian instead of its color, with the same weights. It encodes depths
/// as SH colors and runs a forward pass, so that every renderer can do it. Keeps the Gaussians'
/// span, which outlives it, and 12 bytes per Gaussian on the host and on the device. Throws Error
/// where memory runs out.
class SurfaceRenderer {
 public:
  /// host       the same Gaussians in host memory; read only in the constructor
  /// settings   as for the color; SH degree and background are ignored, and tensor cores are not
  ///            used, since they round colors to 11 bits
  SurfaceRenderer(Renderer& renderer, const GaussiansSpan& gaussians, const Gaussians& host,
                  const RenderSettings& settings);

  /// The mean depth of each pixel: sum(w z) / sum(w) over its fragments, where z is the depth of a
  /// Gaussian's center along the viewing axis, or through a wide lens its distance. 0 where alpha
  /// is below kMinAlpha.
  /// (height, width, 1), world units
  ImageF depth(const Camera& camera);

 private:
  Renderer& renderer_;
  GaussiansSpan gaussians_;
  RenderSettings settings_;
  std::vector<Vec3f> means_;  // (N) world units
  Buffer<Vec3f> sh0_;         // (N) depths, encoded as colors
  RenderPass pass_;
};

/// The normals of the surface of a depth picture, in world space, of length 1, towards the camera.
/// A normal is the cross product of the differences between the points of neighboring pixels; at a
/// border the pixel itself replaces the missing neighbor. (0, 0, 0) where a pixel or all its
/// neighbors have no depth. Throws Error for a camera with a lens.   (height, width, 3)
ImageF normals_of(const ImageF& depth, const Camera& camera);

/// The normals in the frame of a camera: x right, y up, z towards the camera, as is usual for
/// pictures of normals.
ImageF normals_in_camera(const ImageF& normals, const Camera& camera);

}  // namespace gs
