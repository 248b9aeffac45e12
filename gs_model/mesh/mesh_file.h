// SPDX-License-Identifier: Apache-2.0
// Files of triangles: .glb, .obj, .ply, .stl, and .usda, .usdc and .usdz. Positions are those of the
// model, in its units and axes; a .glb and the files of USD are turned by half a turn about z, as those
// of a model are, so that y points up.
#pragma once

#include <filesystem>
#include <string>
#include <vector>

#include "gs_core/system/files/byte_sink.h"
#include "gs_core/triangle_mesh.h"
#include "gs_model/formats/usd/usd.h"

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
  /// model's own file has (GaussianModel); a .stl has no place for it. Files of USD have the views, in
  /// the frame of the mesh. Throws Error, as the sink does, and where the mesh is too large for the
  /// format.
  void (*write)(ByteSink& sink, const TriangleMesh& mesh, const Vec3d& world_offset,
                const MeshTextureFile& texture, const std::vector<NamedView>& views);
  bool takes_textures = false;  // a .glb and a .usdz hold it, an .obj names its .mtl
};

/// The format of a file by its ending. Throws UsageError, which lists all of them.
const MeshFormat& mesh_format_of(const std::filesystem::path& file);

}  // namespace gs
