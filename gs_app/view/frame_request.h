// SPDX-License-Identifier: Apache-2.0
// The words of a /frame request: a camera, what to show of it, how well.
#pragma once

#include <string>

#include "gs_app/export/view_pictures.h"
#include "gs_app/view/http_server.h"
#include "gs_core/camera.h"

namespace gs {

inline constexpr int kLargestFrameSide = 4096;  // pixels

struct FrameRequest {
  Camera camera;
  Quantity quantity = Quantity::color;
  int quality = 85;    // of JPEG, 1 to 100
  std::string client;  // whose request it is: a newer one of the same client overtakes it
};

/// w h fx fy cx cy (pixels), m (world_from_camera, 16 numbers by rows, commas between), and where given mode, q, client.
/// Throws UsageError that names the word which cannot be taken.
FrameRequest frame_request_of(const HttpRequest& request);

}  // namespace gs
