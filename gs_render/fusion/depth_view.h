// SPDX-License-Identifier: Apache-2.0
// A view as fusion takes it: the surface that each pixel shows, from which side, in which color.
#pragma once

#include <cstdint>
#include <vector>

#include "gs_core/image.h"
#include "gs_render/fusion/depth_picture.h"

namespace gs {

/// Bytes of a DepthView per pixel.
inline constexpr std::size_t kViewBytes = 8;

struct DepthView {
  Camera camera;
  ImageF inverse_depth;              // (height, width, 1)  surface_depth.h
  std::vector<std::uint8_t> facing;  // (height * width)    cosine of ray and normal, times 255
  Image8 color;                      // (height, width, 3)

  /// It must live as long as the result.
  DepthPicture picture() const { return {camera, inverse_depth.pixels.data(), facing.data()}; }
};

/// A view whose normals come from its depth.
///
/// inverse_depth  as surface_inverse_depth() has it
DepthView depth_view(const Camera& camera, ImageF inverse_depth, Image8 color);

}  // namespace gs
