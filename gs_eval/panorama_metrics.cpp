// SPDX-License-Identifier: Apache-2.0
#include "gs_eval/panorama_metrics.h"

#include "gs_render/panorama.h"

namespace gs {

PanoramaMetrics panorama_metrics(Renderer& renderer, const PackedScene& scene, const View& front,
                                 const RenderSettings& settings, RenderPass& pass) {
  const View whole = front.panorama();
  Camera camera = front.camera;
  camera.width = whole.photo.width, camera.height = whole.photo.height;
  std::array<ImageF, 2> halves;
  for (std::size_t half = 0; half < 2; ++half) {
    renderer.draw(scene, panorama_halves(camera)[half], settings, pass);
    halves[half] = image_of(pass);
  }
  const ImageF render = joined_panorama(camera, halves, true);
  const Vec3f& background = settings.background;
  return {{psnr(render, whole, background), ssim(render, whole, background)},
          ws_psnr(render, whole, background)};
}

}  // namespace gs
