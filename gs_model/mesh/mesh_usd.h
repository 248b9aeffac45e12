// SPDX-License-Identifier: Apache-2.0
// A mesh in a stage of USD; used by mesh_file.cpp only.
//
//   /Scene/Mesh                   Mesh, half a turn about z from the model: y up
//     points, normals, faceVertexCounts, faceVertexIndices, extent
//     primvars:displayColor           color3f[]     linear; of vertices
//     primvars:st                     texCoord2f[]  in place of colors, from the lower left corner
//     subdivisionScheme, doubleSided                "none", 1
//   /Scene/Looks/Surface          Material (UsdPreviewSurface) with the texture, in a .usdz
//   /Scene/Cameras/view_I_NAME    as in the stage of a model (usd.h)
#pragma once

#include <vector>

#include "gs_model/mesh/mesh_file.h"

namespace gs {

void write_mesh_usda(ByteSink& sink, const TriangleMesh& mesh, const Vec3d& world_offset,
                     const MeshTextureFile& texture, const std::vector<NamedView>& views);
void write_mesh_usdc(ByteSink& sink, const TriangleMesh& mesh, const Vec3d& world_offset,
                     const MeshTextureFile& texture, const std::vector<NamedView>& views);
void write_mesh_usdz(ByteSink& sink, const TriangleMesh& mesh, const Vec3d& world_offset,
                     const MeshTextureFile& texture, const std::vector<NamedView>& views);

}  // namespace gs
