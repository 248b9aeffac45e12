// SPDX-License-Identifier: Apache-2.0
// The picture of a mesh, without light: the colors of its vertices, or its texture.
#pragma once

#include "gs_core/camera.h"
#include "gs_core/image.h"
#include "gs_core/triangle_mesh.h"

namespace gs {

struct MeshPicture {
  ImageF color;        // (height, width, 3)  display sRGB
  double covered = 0;  // share of the picture that shows the mesh
};

/// Draws both sides of all triangles, the nearest one at each of four places of a pixel. Colors and
/// places in the texture are interpolated in perspective. Through a lens edges stay straight, which
/// is right for small triangles. What has no colors is gray. The same for any number of threads.
///
/// background  display sRGB, where no triangle is
MeshPicture draw_mesh(const TriangleMesh& mesh, const Camera& camera, const Vec3f& background);

}  // namespace gs
