// SPDX-License-Identifier: Apache-2.0
#include "gs_train/metrics.h"

#include <algorithm>
#include <cmath>

#include "gs_core/error.h"
#include "gs_core/math/photo_weight.h"
#include "gs_core/math/ssim.h"
#include "gs_train/window.h"

namespace gs {
namespace {

constexpr double kIdenticalPsnr = 100;  // dB; the value for identical pictures

void check_sizes(const ImageF& render, const Image8& photo) {
  GS_CHECK(render.width == photo.width && render.height == photo.height && render.channels == 3 &&
           photo.channels == 3);
}

/// One value of both pictures in 0..1, and the share of its pixel in the mean.
struct ComparedValue {
  double x, y, share;
};

/// at(pixel, channel) gives the values.
template <class At>
double psnr_of(const ImageF& render, At&& at) {
  double sum = 0, shares = 0;
  for (std::size_t i = 0; i < render.pixels.size(); ++i) {
    const ComparedValue value = at(i / 3, int(i % 3));
    sum += value.share * (value.x - value.y) * (value.x - value.y);
    shares += value.share;
  }
  GS_CHECK(shares > 0);
  const double mse = sum / shares;
  return mse > 0 ? std::min(-10 * std::log10(mse), kIdenticalPsnr) : kIdenticalPsnr;
}

template <class At>
double ssim_of(const ImageF& render, At&& at) {
  const std::size_t plane = std::size_t(render.width) * render.height, n = 3 * plane;
  Buffer<float> moments(5 * n, host_memory()), scratch;
  for (std::size_t i = 0; i < plane; ++i)
    for (int c = 0; c < 3; ++c) {
      const ComparedValue value = at(i, c);
      const float x = float(value.share * value.x), y = float(value.share * value.y);
      const float values[5] = {x, y, x * x, y * y, x * y};
      for (int k = 0; k < 5; ++k) moments[k * n + c * plane + i] = values[k];
    }
  window_means(moments.span(), 15, render.width, render.height, scratch);
  double sum = 0;
  std::size_t count = 0;
  for (std::size_t i = 0; i < n; ++i) {
    if (!(at(i % plane, int(i / plane)).share > 0)) continue;
    sum += ssim_index(LocalMoments<float>{moments[i], moments[n + i], moments[2 * n + i],
                                          moments[3 * n + i], moments[4 * n + i]});
    ++count;
  }
  GS_CHECK(count > 0);
  return sum / double(count);
}

auto plain_values(const ImageF& render, const Image8& photo) {
  return [&](std::size_t pixel, int c) {
    return ComparedValue{render.pixels[3 * pixel + c], photo.pixels[3 * pixel + c] / 255.0, 1};
  };
}

/// The photo's value as a render under that exposure is compared with it, in 0..1.
double photo_value(const View& view, const Vec3f& background, const Vec3f& exposure,
                   std::size_t pixel, int c) {
  const double photo = view.photo.pixels[3 * pixel + c] / 255.0;
  if (!view.over_background || view.mask.empty()) return photo;
  const PhotoWeight<double> weight = photo_weight(view.mask.pixels[pixel] / 255.0,
                                                  double(exposure[c]), double(background[c]), true);
  return weight.cover * photo + weight.backdrop;
}

// The compared values of a picture to which the exposure has been applied.
auto values_of(const ImageF& render, const View& view, const Vec3f& background,
               const Vec3f& exposure) {
  return [&render, &view, &background, exposure](std::size_t pixel, int c) {
    return ComparedValue{render.pixels[3 * pixel + c],
                         photo_value(view, background, exposure, pixel, c),
                         view.has_untrained_pixels() ? view.mask.pixels[pixel] / 255.0 : 1.0};
  };
}

ImageF under_exposure(ImageF render, const Vec3f& exposure) {
  for (std::size_t i = 0; i < render.pixels.size(); ++i)
    render.pixels[i] = std::clamp(exposure[int(i % 3)] * render.pixels[i], 0.0f, 1.0f);
  return render;
}

}  // namespace

double psnr(const ImageF& render, const Image8& photo) {
  check_sizes(render, photo);
  return psnr_of(render, plain_values(render, photo));
}

double ssim(const ImageF& render, const Image8& photo) {
  check_sizes(render, photo);
  return ssim_of(render, plain_values(render, photo));
}

double psnr(const ImageF& render, const View& view, const Vec3f& background) {
  check_sizes(render, view.photo);
  const ImageF exposed = under_exposure(render, view.exposure);
  return psnr_of(exposed, values_of(exposed, view, background, view.exposure));
}

double ssim(const ImageF& render, const View& view, const Vec3f& background) {
  check_sizes(render, view.photo);
  const ImageF exposed = under_exposure(render, view.exposure);
  return ssim_of(exposed, values_of(exposed, view, background, view.exposure));
}

Image8 shown_photo(const View& view, const Vec3f& background) {
  Image8 shown = view.photo;
  if (!view.over_background || view.mask.empty()) return shown;
  for (std::size_t i = 0; i < shown.pixels.size(); ++i) {
    const double value = photo_value(view, background, view.exposure, i / 3, int(i % 3));
    shown.pixels[i] = std::uint8_t(std::lround(255 * std::clamp(value, 0.0, 1.0)));
  }
  return shown;
}

Evaluation evaluate(Renderer& renderer, const GaussiansSpan& gaussians,
                    const std::vector<View>& views, const RenderSettings& settings,
                    const std::function<void(std::size_t, const View&, const ImageF&)>& on_view) {
  const auto trains_nowhere = [](const View& view) {
    return view.has_untrained_pixels() &&
           std::all_of(view.mask.pixels.begin(), view.mask.pixels.end(),
                       [](std::uint8_t value) { return value == 0; });
  };
  Evaluation evaluation;
  RenderPass pass(renderer.memory());
  for_each_with_photo(views, views.size(), [&](std::size_t i, const View& view) {
    renderer.forward(gaussians, view.camera, settings, pass);
    const ImageF render = image_of(pass);
    if (on_view) on_view(i, view, render);
    if (trains_nowhere(view)) return;
    check_sizes(render, view.photo);
    const Vec3f& background = settings.background;
    const auto as_it_is = values_of(render, view, background, Vec3f(1));
    ViewMetrics metrics{view.name, psnr_of(render, as_it_is), ssim_of(render, as_it_is)};
    if (view.has_exposure()) {
      const ImageF exposed = image_of(pass, view.exposure);
      const auto values = values_of(exposed, view, background, view.exposure);
      metrics.psnr_exposure = psnr_of(exposed, values);
      metrics.ssim_exposure = ssim_of(exposed, values);
      evaluation.has_exposures = true;
    }
    evaluation.psnr += metrics.psnr;
    evaluation.ssim += metrics.ssim;
    evaluation.psnr_exposure += metrics.psnr_exposure;
    evaluation.ssim_exposure += metrics.ssim_exposure;
    metrics.time = view.camera.time;
    evaluation.views.push_back(std::move(metrics));
  });
  const double count = double(std::max<std::size_t>(evaluation.views.size(), 1));
  for (double* sum :
       {&evaluation.psnr, &evaluation.ssim, &evaluation.psnr_exposure, &evaluation.ssim_exposure})
    *sum /= count;
  return evaluation;
}

}  // namespace gs
