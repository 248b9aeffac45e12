// SPDX-License-Identifier: Apache-2.0
// Where a picture shows a point.
#pragma once

#include <optional>

#include "gs_core/math/render/projection.h"

namespace gs {

/// Whether a place lies in the picture. Its right and lower edges do not count.
///
/// pixel  pixel (x, y) has its center at (x + 0.5, y + 0.5)
inline bool holds_pixel(const Camera& camera, const Vec2f& pixel) {
  return pixel.x >= 0 && pixel.y >= 0 && pixel.x < float(camera.width) &&
         pixel.y < float(camera.height);
}

/// The place of a point in the picture; none if it lies outside, or out of the camera's sight.
inline std::optional<Vec2f> seen_pixel(const Camera& camera, const Vec3f& point) {
  const Vec3f p = to_camera(camera, point);
  if (!is_in_sight(camera, p)) return std::nullopt;
  const Vec2f pixel = pixel_of(camera, p);
  if (!holds_pixel(camera, pixel)) return std::nullopt;
  return pixel;
}

}  // namespace gs
