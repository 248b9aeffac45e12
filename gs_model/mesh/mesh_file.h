// SPDX-License-Identifier: Apache-2.0
// Files of triangles: .glb, .obj, .ply and .stl. Positions are those of the model, in its units and
// axes; a .glb is turned by half a turn about z, as the .glb of a model is, so that y points up.
#pragma once

#include <filesystem>
#include <string>
#include <vector>

#include "gs_core/system/files/byte_sink.h"
#include "gs_core/triangle_mesh.h"

namespace gs {

/// The texture of a mesh as a file.
struct MeshTextureFile {
  std::string png;   // its bytes; empty: vertices have colors, and no places in the texture
  std::string name;  // of the .mtl and the .png beside an .obj, without their endings

  /// The .mtl beside an .obj.
  std::string material() const;
};

struct MeshFormat {
  const char* ending;  // ".glb"
  /// Writes a mesh with normals, colors and at least one triangle. `world_offset` is what the
  /// model's own file has (GaussianModel); a .stl has no place for it. Throws Error, as the sink
  /// does, and where the mesh is too large for the format.
  void (*write)(ByteSink& sink, const TriangleMesh& mesh, const Vec3d& world_offset,
                const MeshTextureFile& texture);
  bool takes_textures = false;  // a .glb holds it, an .obj names its .mtl
};

/// The format of a file by its ending. Throws UsageError, which lists all of them.
const MeshFormat& mesh_format_of(const std::filesystem::path& file);

}  // namespace gs
