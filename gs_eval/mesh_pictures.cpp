// SPDX-License-Identifier: Apache-2.0
#include "gs_eval/mesh_pictures.h"

#include "gs_render/mesh/draw_mesh.h"

namespace gs {

MeshPictures compare_mesh_pictures(const TriangleMesh& mesh, const std::vector<View>& views,
                                   const Vec3f& background) {
  MeshPictures sums;
  for_each_with_photo(views, views.size(), [&](std::size_t, const View& view) {
    if (view.trains_nowhere()) return;
    const MeshPicture picture = draw_mesh(mesh, view.camera, background);
    sums.psnr += psnr(picture.color, view, background);
    sums.ssim += ssim(picture.color, view, background);
    sums.covered += picture.covered;
    ++sums.views;
  });
  if (sums.views == 0) return sums;
  const double count = double(sums.views);
  return {{sums.psnr / count, sums.ssim / count}, sums.covered / count, sums.views};
}

}  // namespace gs
