// SPDX-License-Identifier: Apache-2.0
// A view as fusion takes it: the surface that each pixel shows, from which side, in which color.
#pragma once

#include <cstdint>
#include <vector>

#include "gs_core/camera.h"
#include "gs_core/image.h"

namespace gs {

/// Bytes of a DepthView per pixel.
inline constexpr std::size_t kViewBytes = 8;

struct DepthView {
  Camera camera;
  ImageF inverse_depth;              // (height, width, 1)  surface_depth.h
  std::vector<std::uint8_t> facing;  // (height * width)    cosine of ray and normal, times 255
  Image8 color;                      // (height, width, 3)

  /// The cosine at a pixel, 0 to 1.
  float facing_at(int x, int y) const {
    return float(facing[std::size_t(y) * camera.width + x]) / 255.0f;
  }
  /// The inverse depth at a point of the picture, pixels. Between four pixels of one surface it is
  /// bilinear, which is exact on planes; elsewhere it is that of the nearest pixel. The point lies in
  /// the picture.
  float inverse_depth_at(float x, float y) const;
};

/// A view whose normals come from its depth. Cosines are 1/4 at least.
///
/// inverse_depth  as surface_inverse_depth() has it
DepthView depth_view(const Camera& camera, ImageF inverse_depth, Image8 color);

}  // namespace gs
