// SPDX-License-Identifier: Apache-2.0
// Reads surfaces of any program: triangles, or points alone.
#pragma once

#include <filesystem>
#include <string>

#include "gs_core/triangle_mesh.h"

namespace gs {

struct MeshOfFile {
  TriangleMesh mesh;  // without triangles: points; normals of a .ply only; no texture
  Vec3d world_offset{
      0.0};  // as our writers note it; added to the vertices it gives the scene's axes
  std::string texture_png = {};  // of a .glb whose vertices all have places in one texture
};

/// Reads a .ply (text or binary), .obj, .glb or binary .stl. Polygons become fans of triangles. A .glb
/// is turned back by half a turn about z. Triangles of a .stl share no vertices. Throws Error, with
/// the file and a remedy, for damaged files, files without a vertex, and vertices that are not
/// finite; UsageError for another ending.
MeshOfFile read_mesh(const std::filesystem::path& path);

}  // namespace gs
