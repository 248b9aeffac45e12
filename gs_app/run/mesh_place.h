// SPDX-License-Identifier: Apache-2.0
// Where the mesh of a model lies.
#pragma once

#include <filesystem>

namespace gs {

/// mesh.glb in the folder of a run, or else what `gemsplat mesh` writes beside a model of this name
/// if no -o says otherwise. Empty where neither is there.
std::filesystem::path mesh_beside(const std::filesystem::path& model);

}  // namespace gs
