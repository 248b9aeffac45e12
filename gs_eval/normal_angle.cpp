// SPDX-License-Identifier: Apache-2.0
#include "gs_eval/normal_angle.h"

#include <cmath>
#include <numbers>

#include "gs_core/math/render/surface_loss.h"

namespace gs {

void measure_normals(Renderer& renderer, const Gaussians& gaussians, const std::vector<View>& views,
                     const RenderSettings& settings, Evaluation& evaluation) {
  if (gaussians.has_time) return;
  RenderSettings of_surface = settings;
  of_surface.blends_surface = true;
  of_surface.order = RenderOrder::z;
  RenderPass pass(renderer.memory());
  double sum = 0;
  std::size_t count = 0;
  for (const View& view : views) {
    const Camera& camera = view.camera;
    if (camera.has_lens()) continue;
    renderer.forward(gaussians.span(), camera, of_surface, pass);
    const std::vector<SurfaceRow> sums = pass.surface_image.download();
    std::vector<float> inverse_depth(sums.size());
    const std::vector<float> no_photo(sums.size());
    const SurfacePicture picture{
        camera, sums.data(), inverse_depth.data(), {no_photo.data(), camera.width, camera.height}};
    const auto for_each_pixel = [&](const auto& f) {
      for (int y = 0; y < camera.height; ++y)
        for (int x = 0; x < camera.width; ++x) f(x, y, from_axis(camera, x, y));
    };
    for_each_pixel([&](int x, int y, const Vec2f& from) {
      const std::size_t i = picture.index(x, y);
      inverse_depth[i] = mean_inverse_depth(sums[i], from);
    });
    for_each_pixel([&](int x, int y, const Vec2f& from) {
      PixelSurface<float> at;
      if (!picture.find(x, y, at)) return;
      const double cosine = 1 - double(normal_error(camera, from, at));
      sum += std::acos(std::min(std::max(cosine, -1.0), 1.0));
      ++count;
    });
  }
  if (count > 0) evaluation.normal_angle = sum / double(count) * (180 / std::numbers::pi);
}

}  // namespace gs
