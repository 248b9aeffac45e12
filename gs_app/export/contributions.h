// SPDX-License-Identifier: Apache-2.0
// How much of the pictures of several cameras each Gaussian makes up.
#pragma once

#include <vector>

#include "gs_core/camera.h"
#include "gs_render/renderer.h"

namespace gs {

/// A camera sees a Gaussian that contributes at least so much to its picture.   pixels
inline constexpr float kLeastSeen = 1.0f / 255;

/// (N) each, over the pictures of some cameras (contribution.h).
struct Contributions {
  std::vector<float> largest;        // pixels: the largest contribution to one picture
  std::vector<float> sum;            // pixels: those to all pictures
  std::vector<std::uint32_t> views;  // that see the Gaussian
};

/// Renders every camera forward and backward. `gaussians` are in the renderer's memory. Shows a
/// progress bar where that takes a while and `show_progress` is set.
Contributions contributions_of(Renderer& renderer, const GaussiansSpan& gaussians,
                               const std::vector<Camera>& cameras, const RenderSettings& settings,
                               bool show_progress);

}  // namespace gs
