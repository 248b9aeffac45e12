// SPDX-License-Identifier: Apache-2.0
// A generated scene for `gemsplat bench --gaussians` and `gemsplat selftest`: random Gaussians in a
// ball, cameras on a ring around it that look at its center, and photos of random values. A seed
// gives the same scene on every machine.
#pragma once

#include <cstdint>
#include <vector>

#include "gs_core/gaussians.h"
#include "gs_core/scene.h"

namespace gs {

/// The parameters of a generated scene.
struct SceneRecipe {
  std::size_t gaussians = 1000;
  int width = 320, height = 240;  // pixels
  int views = 8;
  // Radius of the ball, as a fraction of the cameras' distance from its center.
  float reach = 0.8f;
  // Standard deviations of the Gaussians' axes, in pixels seen from that distance.
  float sigma_low = 0.5f, sigma_high = 7;
  float opacity_low = 0.05f, opacity_high = 0.95f;
  std::uint64_t seed = 1;
  bool moves = false;  // Gaussians in space and time
};

struct GeneratedScene {
  GaussianModel model;      // with coefficients of every SH degree
  std::vector<View> views;  // of a scene that moves, spread over its duration
};

GeneratedScene generated_scene(const SceneRecipe& recipe);

}  // namespace gs
