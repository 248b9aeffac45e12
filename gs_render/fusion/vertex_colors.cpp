// SPDX-License-Identifier: Apache-2.0
#include "gs_core/threads/parallel.h"
#include "gs_render/fusion/marching_cubes.h"
#include "gs_render/fusion/view_color.h"

namespace gs {

constexpr Rgb8 kUnseenColor = {128, 128, 128};

std::vector<char> color_vertices(const std::vector<DepthView>& views, float voxel,
                                 TriangleMesh& mesh) {
  mesh.colors.assign(mesh.vertices.size(), kUnseenColor);
  std::vector<char> is_seen(mesh.vertices.size(), 0);
  parallel_for(mesh.vertices.size(), 1024, [&](std::size_t v) {
    const std::optional<Vec3f> color = view_color(views, mesh.vertices[v], voxel);
    if (!color) return;
    is_seen[v] = 1;
    mesh.colors[v] = {byte_of(color->x), byte_of(color->y), byte_of(color->z)};
  });
  return is_seen;
}

}  // namespace gs
