// SPDX-License-Identifier: Apache-2.0
// What happens to a mesh between its extraction and its file.
#pragma once

#include <cstddef>

#include "gs_core/triangle_mesh.h"

namespace gs {

/// Removes small pieces, which are triangles that shared vertices connect, and vertices without a
/// triangle. Vertices and triangles keep their order. Returns the number of pieces that stay.
///
/// most  the largest ones stay, so many at most; 0: those with at least 50 triangles and 0.01 % of
///       all. The largest always stays.
std::size_t keep_large_pieces(TriangleMesh& mesh, std::size_t most);

/// Removes vertices that no triangle has. The others keep their order.
void drop_unused_vertices(TriangleMesh& mesh);

/// Gives each vertex the normal of its triangles, weighted by area.
void compute_normals(TriangleMesh& mesh);

}  // namespace gs
