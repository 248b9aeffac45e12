// SPDX-License-Identifier: Apache-2.0
// The surface of a volume as triangles, and their colors.
#pragma once

#include <array>

#include "gs_core/triangle_mesh.h"
#include "gs_render/fusion/depth_view.h"
#include "gs_render/fusion/volume.h"

namespace gs {

/// The triangles of a cell of eight voxels, each as three of its twelve edges: what Lorensen and
/// Cline 1987 have as a table, made from the definition. Bit c of `solid` says that corner c is
/// solid; the bits of c are its x, y and z. Edge 4 a + u + 2 v runs along axis a, from the corner with
/// u and v along the next two axes.
///
/// On a face with four crossings the two solid corners are apart, seen from either side, and no
/// edge between two triangles of a cell lies in a face. Edges within a volume thus have two
/// triangles.
const std::vector<std::array<int, 3>>& cell_triangles(unsigned solid);

/// The zero level of the distance, outwards from what is solid. Cells with a voxel of which no view
/// says anything have no triangles. Vertices that no triangle has stay. Throws Error
/// (out_of_memory) where there are more than 2^32 vertices.
TriangleMesh surface_of(const Volume& volume);

/// Gives each vertex the mean color of the four views that see it best, weighted by cos^2 o^2. A view
/// sees it where it is as deep as its pixel, by two voxels. Gray where none does. Returns which
/// vertices are seen.   (V)
std::vector<char> color_vertices(const std::vector<DepthView>& views, float voxel,
                                 TriangleMesh& mesh);

}  // namespace gs
