// SPDX-License-Identifier: Apache-2.0
#include "gs_app/run/mesh_place.h"

#include "gs_app/run/output_place.h"

namespace gs {

std::filesystem::path mesh_beside(const std::filesystem::path& model) {
  for (const std::filesystem::path& mesh : {model / "mesh.glb", beside(model, "-mesh.glb")})
    if (std::filesystem::is_regular_file(mesh)) return mesh;
  return {};
}

}  // namespace gs
