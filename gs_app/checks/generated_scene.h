// SPDX-License-Identifier: Apache-2.0
// A scene without files: random Gaussians in a ball, cameras on a ring around it that look at its middle, and
// photos of random values: what the program times and checks itself on; the same for a seed on every machine.
#pragma once

#include <cstdint>
#include <vector>

#include "gs_core/gaussians.h"
#include "gs_core/scene.h"

namespace gs {

/// How large a scene to make, and of what.
struct SceneRecipe {
  std::size_t gaussians = 1000;
  int width = 320, height = 240;           // pixels
  int views = 8;
  float reach = 0.8f;                      // radius of the ball, in distances of the cameras from its middle
  float sigma_low = 0.5f, sigma_high = 7;  // pixels of the Gaussians' axes, seen from that distance
  float opacity_low = 0.05f, opacity_high = 0.95f;
  std::uint64_t seed = 1;
};

struct GeneratedScene {
  GaussianModel model;      // with coefficients of every SH degree
  std::vector<View> views;
};

GeneratedScene generated_scene(const SceneRecipe& recipe);

}  // namespace gs
