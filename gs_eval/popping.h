// SPDX-License-Identifier: Apache-2.0
// How much pops up or vanishes in a film: what neighboring frames differ by, beyond what the motion
// of the camera explains.   Radl et al. 2024 (StopThePop), Sec. 5; their flow is that of a network
#pragma once

#include <functional>
#include <vector>

#include "gs_core/camera.h"
#include "gs_core/image.h"

namespace gs {

/// A frame of a film of a scene that does not move, by a pinhole.
struct FilmFrame {
  Camera camera;
  ImageF color;  // (height, width, 3), in [0, 1]
  ImageF depth;  // (height, width, 1), as SurfaceRenderer::depth() gives it
};

/// FLIP of a frame and another one of the same size, moved to its camera by its depths. Pixels count
/// whose surface the other frame shows: where its depth agrees to 1 %. 0 where none does.
double flip_of_neighbor(const FilmFrame& frame, const FilmFrame& other);

/// The means over places of a film: of frames and the next ones, and of those 7 frames apart.
struct Popping {
  double next = 0, seventh = 0;
};
/// Draws three frames at each of ten places. The film has at least 8 frames.
Popping measure_popping(const std::vector<Camera>& film,
                        const std::function<FilmFrame(const Camera&)>& draw);

}  // namespace gs
