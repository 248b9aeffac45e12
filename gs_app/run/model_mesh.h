// SPDX-License-Identifier: Apache-2.0
// The mesh of a model: where it lies, and what it shows.
#pragma once

#include <filesystem>

#include "gs_model/mesh/mesh_read.h"

namespace gs {

/// mesh.glb in the folder of a run, or else what `gemsplat mesh` writes beside a model of this name
/// if no -o says otherwise. Empty where neither is there.
std::filesystem::path mesh_beside(const std::filesystem::path& model);

/// Decodes the texture of a file's mesh, if there is one. Throws Error where it is damaged.
void decode_texture(MeshOfFile& file);

}  // namespace gs
