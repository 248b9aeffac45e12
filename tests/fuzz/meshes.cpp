// SPDX-License-Identifier: Apache-2.0
// Triangles and points, as a file of each ending.
#include "gs_model/mesh/mesh_read.h"

#include "tests/fuzz/fuzz_target.h"

namespace gs::fuzz {
namespace {

void read(std::string_view bytes) {
  for (const char* ending : {".glb", ".obj", ".ply", ".stl"})
    takes([&] {
      const TriangleMesh mesh = read_mesh(file_of(std::string("mesh") + ending, bytes)).mesh;
      for (const Triangle& triangle : mesh.triangles)
        for (const std::uint32_t vertex : triangle)
          require(vertex < mesh.vertices.size(), "a triangle has a vertex that is not there");
    });
}

const Registered registered{"meshes", read};

}  // namespace
}  // namespace gs::fuzz
