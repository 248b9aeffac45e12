// SPDX-License-Identifier: Apache-2.0
// How much the pictures of a mesh look like photos.
#pragma once

#include "gs_core/scene.h"
#include "gs_core/triangle_mesh.h"
#include "gs_eval/metrics.h"

namespace gs {

/// Means over views.
struct MeshPictures : PictureMetrics {
  double covered = 0;     // share of the pictures that shows the mesh
  std::size_t views = 0;  // that were compared; 0: the others are 0
};

/// Draws the mesh (draw_mesh.h) as each view's camera sees it, and compares it with the photo as
/// metrics.h does. Views that are masked everywhere are not counted.
MeshPictures compare_mesh_pictures(const TriangleMesh& mesh, const std::vector<View>& views,
                                   const Vec3f& background);

}  // namespace gs
