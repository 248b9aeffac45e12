// SPDX-License-Identifier: Apache-2.0
// How much pops up or vanishes when a camera turns in place. Such a camera sees the same colors from
// every side, so that two pictures of it, turned back, differ by nothing but the order of Gaussians
// and the approximation of their footprints. Films that also move would add highlights, occlusion
// and the errors of depths.   after Radl et al. 2024 (StopThePop), Sec. 5, whose films move
#pragma once

#include <functional>
#include <vector>

#include "gs_core/camera.h"
#include "gs_core/image.h"

namespace gs {

/// A picture of a scene by a pinhole.
struct FilmFrame {
  Camera camera;
  ImageF color;  // (height, width, 3), in [0, 1]; both sizes are even
};

/// FLIP of a frame and another one from the same place and of the same size, turned to its camera,
/// both reduced by two, so that the interpolation of moved pixels adds little. Pixels count whose
/// ray the other frame has, too. 0 where none has.
double flip_of_turned(const FilmFrame& frame, const FilmFrame& other);

/// Means over places of a pan by a degree a frame: of frames and the next ones, and of those seven
/// frames apart.
struct Popping {
  double next = 0, seventh = 0;
};
/// Draws three frames at ten of the cameras, or at all if they are fewer, in twice their size.
Popping measure_popping(const std::vector<Camera>& cameras,
                        const std::function<ImageF(const Camera&)>& draw);

}  // namespace gs
