// SPDX-License-Identifier: Apache-2.0
#include "gs_train/metrics.h"

#include <cmath>

#include "gs_core/error.h"
#include "gs_core/math/ssim.h"
#include "gs_train/window.h"

namespace gs {
namespace {

constexpr double kIdenticalPsnr = 100;  // dB, stated for pictures without any difference

void check_sizes(const ImageF& render, const Image8& photo) {
  GS_CHECK(render.width == photo.width && render.height == photo.height && render.channels == 3 &&
           photo.channels == 3);
}

}  // namespace

double psnr(const ImageF& render, const Image8& photo) {
  check_sizes(render, photo);
  double sum = 0;
  for (std::size_t i = 0; i < render.pixels.size(); ++i) {
    const double difference = double(render.pixels[i]) - photo.pixels[i] / 255.0;
    sum += difference * difference;
  }
  const double mse = sum / double(render.pixels.size());
  return mse > 0 ? std::min(-10 * std::log10(mse), kIdenticalPsnr) : kIdenticalPsnr;
}

double ssim(const ImageF& render, const Image8& photo) {
  check_sizes(render, photo);
  const std::size_t plane = std::size_t(render.width) * render.height, n = 3 * plane;
  Buffer<float> moments(5 * n, host_memory()), scratch;
  for (std::size_t i = 0; i < plane; ++i)
    for (int c = 0; c < 3; ++c) {
      const float x = render.pixels[3 * i + c], y = photo.pixels[3 * i + c] / 255.0f;
      const float values[5] = {x, y, x * x, y * y, x * y};
      for (int k = 0; k < 5; ++k) moments[k * n + c * plane + i] = values[k];
    }
  window_means(moments.span(), 15, render.width, render.height, scratch);
  double sum = 0;
  for (std::size_t i = 0; i < n; ++i)
    sum += ssim_index(LocalMoments<float>{moments[i], moments[n + i], moments[2 * n + i],
                                          moments[3 * n + i], moments[4 * n + i]});
  return sum / double(n);
}

Evaluation evaluate(Renderer& renderer, const GaussiansSpan& gaussians,
                    const std::vector<View>& views, const RenderSettings& settings,
                    const std::function<void(std::size_t, const View&, const ImageF&)>& on_view) {
  Evaluation evaluation;
  RenderPass pass(renderer.memory());
  for (std::size_t i = 0; i < views.size(); ++i) {
    renderer.forward(gaussians, views[i].camera, settings, pass);
    const ImageF render = image_of(pass);
    if (on_view) on_view(i, views[i], render);
    ViewMetrics view{views[i].name, psnr(render, views[i].photo), ssim(render, views[i].photo)};
    if (views[i].exposure != Vec3f(1)) {
      const ImageF exposed = image_of(pass, views[i].exposure);
      view.psnr_exposure = psnr(exposed, views[i].photo);
      view.ssim_exposure = ssim(exposed, views[i].photo);
      evaluation.has_exposures = true;
    }
    evaluation.psnr += view.psnr / double(views.size());
    evaluation.ssim += view.ssim / double(views.size());
    evaluation.psnr_exposure += view.psnr_exposure / double(views.size());
    evaluation.ssim_exposure += view.ssim_exposure / double(views.size());
    evaluation.views.push_back(std::move(view));
  }
  return evaluation;
}

}  // namespace gs
