// SPDX-License-Identifier: Apache-2.0
// How much each Gaussian contributes to a picture. `gemsplat edit` removes Gaussians by it.
#pragma once

#include <vector>

#include "gs_render/renderer.h"

namespace gs {

/// Measures the contribution of each Gaussian to a view: the sum over pixels of its blending weight
/// T alpha, in pixels. For example, a Gaussian that covers 40 pixels with weight 0.5 contributes
/// 20.
///
/// The contribution is the gradient of the sum of all pixels by the Gaussian's color. Every
/// renderer can therefore compute it by a backward pass: all Gaussians get the same color, and
/// dL/d(image) is 1 in one channel. Keeps the Gaussians' span, which outlives it. Needs 256 bytes
/// per Gaussian and a pass. Throws Error where memory runs out.
class ContributionMeter {
 public:
  /// settings   as for training; SH degree and background are ignored
  ContributionMeter(Renderer& renderer, const GaussiansSpan& gaussians,
                    const RenderSettings& settings);
  /// (N) contributions in pixels; valid until the next call.
  const std::vector<float>& measure(const Camera& camera);

 private:
  Renderer& renderer_;
  RenderSettings settings_;
  GaussiansSpan gaussians_;  // all of one color
  Buffer<Vec3f> sh0_, host_gradient_;
  Buffer<float> dL_dimage_;
  Buffer<Vec2f> dL_dmean2d_;
  Gaussians gradients_;
  RenderPass pass_;
  std::vector<float> shares_;
};

}  // namespace gs
