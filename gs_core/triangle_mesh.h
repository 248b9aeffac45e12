// SPDX-License-Identifier: Apache-2.0
// Triangles with shared vertices, in host memory.
#pragma once

#include <array>
#include <cstdint>
#include <vector>

#include "gs_core/image.h"
#include "gs_core/types.h"

namespace gs {

using Rgb8 = std::array<std::uint8_t, 3>;       // display sRGB
using Triangle = std::array<std::uint32_t, 3>;  // its vertices, counterclockwise from outside

struct TriangleMesh {
  std::vector<Vec3f> vertices;      // (V, 3)  world units
  std::vector<Vec3f> normals;       // (V, 3)  unit length, outwards; empty: not known
  std::vector<Rgb8> colors;         // (V, 3)  empty: not known
  std::vector<Triangle> triangles;  // (F, 3)
  // (V, 2)  places in the texture, whose upper left corner is (0, 0) and whose lower right one is
  // (1, 1); empty: there is none
  std::vector<Vec2f> texture_places;
  Image8 texture;  // (height, width, 3)  takes the place of colors
};

}  // namespace gs
