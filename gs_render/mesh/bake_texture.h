// SPDX-License-Identifier: Apache-2.0
// Paints the texture of a mesh with what views show.
#pragma once

#include <vector>

#include "gs_core/triangle_mesh.h"
#include "gs_render/fusion/depth_view.h"

namespace gs {

/// Each texel whose middle a triangle covers gets the color of the views that see it best
/// (view_color.h), or else that of the vertices; those around it get the mean of what is beside
/// them, `gutter` texels far. Charts do not overlap. The same for any number of threads.
void bake_texture(const std::vector<DepthView>& views, float voxel, int gutter, TriangleMesh& mesh);

}  // namespace gs
