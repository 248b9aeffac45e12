// SPDX-License-Identifier: Apache-2.0
#include "gs_app/export/fidelity.h"

#include <algorithm>

#include "gs_app/pictures/pictures.h"
#include "gs_eval/metrics.h"

namespace gs {
namespace {

ImageF in_float(const Image8& picture) {
  ImageF result(picture.width, picture.height, picture.channels);
  std::transform(picture.pixels.begin(), picture.pixels.end(), result.pixels.begin(),
                 [](std::uint8_t value) { return float(value) / 255; });
  return result;
}

}  // namespace

Fidelity fidelity_of(const GaussianModel& kept, const Viewpoints& viewpoints) {
  Renderer& renderer = viewpoints.backend.renderer();
  const Gaussians gaussians = copy_to(renderer.memory(), kept);
  RenderPass pass(renderer.memory());
  const auto picture_of = [&](const GaussiansSpan& span, const Camera& camera) {
    renderer.forward(span, camera, viewpoints.settings, pass);
    return renderer.picture_of(pass);
  };
  Fidelity fidelity;
  for (const Camera& camera : viewpoints.cameras) {
    const Image8 original = picture_of(viewpoints.original, camera);
    const ImageF picture = in_float(picture_of(gaussians.span(), camera));
    fidelity.psnr += psnr(picture, original);
    fidelity.ssim += ssim(picture, original);
    ++fidelity.num_views;
  }
  if (fidelity.num_views == 0) return fidelity;
  fidelity.psnr /= double(fidelity.num_views);
  fidelity.ssim /= double(fidelity.num_views);
  return fidelity;
}

}  // namespace gs
