// SPDX-License-Identifier: Apache-2.0
// Depth and normals of a model as a camera sees them, out of any renderer: the Gaussians are painted with the quantity instead
// of their colour, and the picture is its blend.
#pragma once

#include "gs_core/image.h"
#include "gs_render/renderer.h"

namespace gs {

/// A model in a renderer's memory and on the host, with what it takes to paint it.
class PaintedModel {
 public:
  /// Both outlive it. `host` is the same model in host memory.
  PaintedModel(Renderer& renderer, const Gaussians& gaussians, const Gaussians& host);

  /// Depth along the viewing axis, blended as colours are: 255 is near, 55 far, between the 2nd and the 98th percentile of what
  /// is in the picture, evenly in 1 / depth. Black where the Gaussians cover less than half.
  Image8 depth(const Camera& camera, const RenderSettings& settings);

  /// The direction of the shortest axis, turned towards the camera: (x, y, z) of camera axes as 127.5 + 127.5 (x, -y, -z),
  /// so that what faces the camera is blue and what faces up green. Black where they cover less than half.
  Image8 normals(const Camera& camera, const RenderSettings& settings);

 private:
  std::vector<float> planes_of(const Camera& camera, RenderSettings settings,
                               const std::vector<Vec3f>& values, float background);

  Renderer& renderer_;
  const Gaussians &gaussians_, &host_;
  Buffer<Vec3f> paint_;  // (N) in the place of sh0
  RenderPass pass_;
};

}  // namespace gs
