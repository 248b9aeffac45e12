// SPDX-License-Identifier: Apache-2.0
// Gives each vertex of a mesh its place in a texture.
#pragma once

#include "gs_core/triangle_mesh.h"

namespace gs {

inline constexpr int kTextureGutter = 2;  // texels around each chart

struct UnwrapRule {
  int largest = 4096;  // most texels along each side of the texture
  float texel = 0;     // > 0  the smallest texel, world units
};

/// Cuts a mesh with normals into charts: connected triangles that face about the same one of 14
/// directions, along which they are projected. Charts lie in rows, with a gutter around each. Vertices
/// at cuts are there once for each chart. The texture is as small as texels of the smallest size
/// permit, and gray. Returns the size of a texel. Throws Error where there are too many charts.
float unwrap_mesh(TriangleMesh& mesh, const UnwrapRule& rule);

}  // namespace gs
