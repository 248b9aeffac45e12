// SPDX-License-Identifier: Apache-2.0
// Fewer triangles for the same surface.
#pragma once

#include <cstddef>

#include "gs_core/triangle_mesh.h"

namespace gs {

/// Contracts edges, the least error first, until a mesh has so many triangles, or until no edge can
/// go. The error of a contraction to p is that of Garland and Heckbert 1997,
///
///   sum over planes of area (n . p + d)^2,   p the best of both ends and their middle
///
/// where the planes are those of all triangles that have gone into both ends, and at a border one
/// more through each edge. No contraction turns a triangle over or joins what was apart, so that a
/// closed mesh stays closed. Normals are left out, as they change. One thread; the same for each
/// call.
void decimate_mesh(TriangleMesh& mesh, std::size_t triangles);

}  // namespace gs
