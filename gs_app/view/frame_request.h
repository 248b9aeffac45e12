// SPDX-License-Identifier: Apache-2.0
// Parses the query of a /frame request: a camera, the quantity to show, the JPEG quality.
#pragma once

#include <optional>
#include <string>

#include "gs_app/export/view_pictures.h"
#include "gs_app/view/http/http_server.h"
#include "gs_core/camera.h"

namespace gs {

inline constexpr int kLargestFrameSide = 4096;  // pixels

struct FrameRequest {
  Camera camera;
  Quantity quantity = Quantity::color;
  std::optional<std::size_t> look = {};  // the camera whose photo's colors are shown
  std::optional<std::size_t> lens = {};  // the camera through whose lens the frame is seen
  int quality = 85;                      // of JPEG, 1 to 100
  std::string client;  // who asks: a newer request of the same client replaces one that waits
};

/// Required: w h fx fy cx cy in pixels, and m, the matrix world_from_camera as 16 numbers by rows
/// with commas. Optional: mode, q, look, lens, client, and t, the time of a scene that moves, 0 to 1.
/// Throws UsageError that names the parameter at fault.
FrameRequest frame_request_of(const HttpRequest& request);

}  // namespace gs
