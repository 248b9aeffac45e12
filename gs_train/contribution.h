// SPDX-License-Identifier: Apache-2.0
// How much of a picture each Gaussian is: what a trained model is cleaned by.
#pragma once

#include <vector>

#include "gs_render/renderer.h"

namespace gs {

/// Measures the share that each Gaussian has in a view: the sum over pixels of T alpha, what its color is multiplied
/// by.   pixels
///
/// It is the gradient of the sum of all pixels by that Gaussian's color, so every renderer can tell it: all are given
/// one color, and the picture's gradient is 1. Keeps the Gaussians' span, which outlives it; needs 256 bytes for each, and a
/// pass.
/// Throws Error where memory runs out.
class ContributionMeter {
 public:
  /// settings   as for training; SH degree and background make no difference
  ContributionMeter(Renderer& renderer, const GaussiansSpan& gaussians,
                    const RenderSettings& settings);
  /// (N) of the view; valid until the next call.
  const std::vector<float>& measure(const Camera& camera);

 private:
  Renderer& renderer_;
  RenderSettings settings_;
  GaussiansSpan gaussians_;  // of one color
  Buffer<Vec3f> sh0_, host_gradient_;
  Buffer<float> dL_dimage_;
  Buffer<Vec2f> dL_dmean2d_;
  Gaussians gradients_;
  RenderPass pass_;
  std::vector<float> shares_;
};

}  // namespace gs
