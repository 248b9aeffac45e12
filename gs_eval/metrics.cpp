// SPDX-License-Identifier: Apache-2.0
#include "gs_eval/metrics.h"

#include <algorithm>
#include <cmath>

#include "gs_core/error.h"
#include "gs_core/math/loss/photo_weight.h"
#include "gs_core/math/loss/ssim.h"
#include "gs_core/threads/parallel.h"
#include "gs_eval/color_correction.h"
#include "gs_eval/flip/flip.h"
#include "gs_eval/lpips/lpips.h"
#include "gs_train/stages/window.h"

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
    sum += ssim_index(WindowMeans<float>{moments[i], moments[n + i], moments[2 * n + i],
                                         moments[3 * n + i], moments[4 * n + i]});
    ++count;
  }
  GS_CHECK(count > 0);
  return sum / double(count);
}

template <class At>
PerceptualMetrics perceptual_of(const ImageF& render, bool is_weighted, Lpips* lpips, At&& at) {
  ComparedPictures pictures{render, render, {}};
  if (is_weighted) pictures.weight = ImageF(render.width, render.height, 1);
  for (std::size_t i = 0; i < render.pixels.size(); ++i) {
    const ComparedValue value = at(i / 3, int(i % 3));
    pictures.render.pixels[i] = float(value.share * value.x);
    pictures.photo.pixels[i] = float(value.share * value.y);
    if (is_weighted) pictures.weight.pixels[i / 3] = float(value.share);
  }
  PerceptualMetrics metrics{flip(pictures)};
  if (lpips) metrics.lpips = lpips->distance(pictures);
  return metrics;
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

// What it is compared with; in front of a background, which the photo shows as well. The appearance
// has shown the picture.
auto values_under(const ImageF& shown, const View& view, const Vec3f& background,
                  Appearance& appearance) {
  const bool is_over = view.over_background && !view.mask.empty();
  if (is_over) appearance.show_background(background, shown.width, shown.height);
  const std::size_t plane = std::size_t(shown.width) * std::size_t(shown.height);
  return [&shown, &view, &appearance, is_over, plane](std::size_t pixel, int c) {
    const Vec3f behind =
        is_over ? Vec3f(appearance.behind()[std::size_t(c) * plane + pixel]) : Vec3f(0);
    return ComparedValue{shown.pixels[3 * pixel + std::size_t(c)],
                         photo_value(view, behind, Vec3f(1), pixel, c),
                         view.has_untrained_pixels() ? view.mask.pixels[pixel] / 255.0 : 1.0};
  };
}

PictureMetrics photometric_metrics(const Planes& planes, const View& view, const Vec3f& background,
                                   Appearance& appearance) {
  const ImageF shown = shown_image(planes, appearance);
  const auto values = values_under(shown, view, background, appearance);
  return {psnr_of(shown, values), ssim_of(shown, values)};
}

template <class At>
PictureMetrics corrected_metrics(const ImageF& render, At&& at) {
  ColorFit fits[3];
  for (std::size_t i = 0; i < render.pixels.size(); ++i) {
    const ComparedValue value = at(i / 3, int(i % 3));
    fits[i % 3].add(value.x, value.y, value.share);
  }
  const ColorLine lines[3] = {fits[0].line(), fits[1].line(), fits[2].line()};
  const auto corrected = [&](std::size_t pixel, int c) {
    ComparedValue value = at(pixel, c);
    value.x = lines[c].corrected(value.x);
    return value;
  };
  return {psnr_of(render, corrected), ssim_of(render, corrected)};
}

// A view whose picture is drawn and whose metrics are not measured yet.
struct DrawnView {
  View view;                                                      // with its photo
  std::vector<float> planes;                                      // (3, H, W)
  ImageF render;                                                  // the same, clamped
  std::unique_ptr<Appearance> appearance{}, solved_appearance{};  // may be null
  ViewMetrics metrics{};
};

void measure(DrawnView& drawn, const Vec3f& background, const EvaluationOptions& options) {
  const View& view = drawn.view;
  const Planes planes{drawn.planes.data(), drawn.render.width, drawn.render.height};
  check_sizes(drawn.render, view.photo);
  const auto perceptual = [&](const ImageF& picture, const auto& values) {
    return perceptual_of(picture, view.has_untrained_pixels(), options.metrics.lpips, values);
  };
  const auto as_it_is = values_of(drawn.render, view, background, Vec3f(1));
  ViewMetrics metrics{view.name, psnr_of(drawn.render, as_it_is), ssim_of(drawn.render, as_it_is)};
  metrics.time = view.camera.time;
  if (options.metrics.is_perceptual) metrics.perceptual = perceptual(drawn.render, as_it_is);
  metrics.perceptual_exposure = metrics.perceptual;
  if (options.is_corrected) metrics.corrected = corrected_metrics(drawn.render, as_it_is);
  if (drawn.appearance)
    metrics.photometric = photometric_metrics(planes, view, background, *drawn.appearance);
  if (view.has_exposure()) {
    const auto take = [&](const ImageF& exposed, const auto& values) {
      metrics.psnr_exposure = psnr_of(exposed, values);
      metrics.ssim_exposure = ssim_of(exposed, values);
      if (options.metrics.is_perceptual) metrics.perceptual_exposure = perceptual(exposed, values);
    };
    if (drawn.solved_appearance) {
      const ImageF exposed = shown_image(planes, *drawn.solved_appearance);
      take(exposed, values_under(exposed, view, background, *drawn.solved_appearance));
    } else {
      const ImageF exposed = image_of({drawn.planes.data(), drawn.planes.size()}, planes.width,
                                      planes.height, view.exposure);
      take(exposed, values_of(exposed, view, background, view.exposure));
    }
  }
  drawn.metrics = std::move(metrics);
}

// How many views are measured at a time, each by a thread of its own: that is several times as fast
// as all threads on one picture, whose steps are short. A view takes some 240 bytes a pixel.
std::size_t views_at_a_time(const std::vector<View>& views, const MetricSet& metrics) {
  constexpr std::size_t kBytesPerPixel = 240, kMostBytes = std::size_t(2) << 30;
  if (metrics.lpips) return 1;  // its network takes all threads
  std::size_t pixels = 1;
  for (const View& view : views)
    pixels = std::max(pixels, std::size_t(view.camera.width) * std::size_t(view.camera.height));
  return std::clamp<std::size_t>(kMostBytes / (kBytesPerPixel * pixels), 1, thread_count());
}

void add(std::optional<PerceptualMetrics>& sum, const std::optional<PerceptualMetrics>& metrics,
         double factor) {
  if (!metrics) return;
  if (!sum) sum = PerceptualMetrics();
  sum->flip += factor * metrics->flip;
  if (metrics->lpips) sum->lpips = sum->lpips.value_or(0) + factor * *metrics->lpips;
}

void add(std::optional<PictureMetrics>& sum, const std::optional<PictureMetrics>& metrics,
         double factor) {
  if (!metrics) return;
  if (!sum) sum = PictureMetrics();
  sum->psnr += factor * metrics->psnr;
  sum->ssim += factor * metrics->ssim;
}

void take_means(Evaluation& evaluation) {
  const double count = double(std::max<std::size_t>(evaluation.views.size(), 1));
  const auto with_look =  // of another scene than the model's, some photos may have none
      double(std::count_if(evaluation.views.begin(), evaluation.views.end(),
                           [](const ViewMetrics& view) { return view.photometric.has_value(); }));
  for (const ViewMetrics& view : evaluation.views) {
    evaluation.psnr += view.psnr;
    evaluation.ssim += view.ssim;
    evaluation.psnr_exposure += view.psnr_exposure;
    evaluation.ssim_exposure += view.ssim_exposure;
    add(evaluation.perceptual, view.perceptual, 1 / count);
    add(evaluation.perceptual_exposure, view.perceptual_exposure, 1 / count);
    add(evaluation.photometric, view.photometric, 1 / with_look);
    add(evaluation.corrected, view.corrected, 1 / count);
  }
  for (double* sum :
       {&evaluation.psnr, &evaluation.ssim, &evaluation.psnr_exposure, &evaluation.ssim_exposure})
    *sum /= count;
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

PerceptualMetrics perceptual_metrics(const ImageF& render, const Image8& photo) {
  check_sizes(render, photo);
  return perceptual_of(render, false, nullptr, plain_values(render, photo));
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

PerceptualMetrics perceptual_metrics(const ImageF& render, const View& view,
                                     const Vec3f& background) {
  check_sizes(render, view.photo);
  const ImageF exposed = under_exposure(render, view.exposure);
  return perceptual_of(exposed, view.has_untrained_pixels(), nullptr,
                       values_of(exposed, view, background, view.exposure));
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
                    const std::function<void(std::size_t, const View&, const ImageF&)>& on_view,
                    const EvaluationOptions& options) {
  return evaluate(renderer, PackedScene(gaussians), views, settings, on_view, options);
}

Evaluation evaluate(Renderer& renderer, const PackedScene& scene, const std::vector<View>& views,
                    const RenderSettings& settings,
                    const std::function<void(std::size_t, const View&, const ImageF&)>& on_view,
                    const EvaluationOptions& options) {
  const auto trains_nowhere = [](const View& view) {
    return view.has_untrained_pixels() &&
           std::all_of(view.mask.pixels.begin(), view.mask.pixels.end(),
                       [](std::uint8_t value) { return value == 0; });
  };
  Evaluation evaluation;
  RenderPass pass(renderer.memory());
  const std::size_t at_a_time = views_at_a_time(views, options.metrics);
  std::vector<DrawnView> drawn;
  const auto measure_drawn = [&] {
    const auto measure_one = [&](std::size_t i) {
      measure(drawn[i], settings.background, options);
    };
    if (drawn.size() == 1)
      measure_one(0);
    else
      parallel_for(drawn.size(), 1, measure_one);
    for (DrawnView& view : drawn) evaluation.views.push_back(std::move(view.metrics));
    drawn.clear();
  };
  for_each_with_photo(views, views.size(), [&](std::size_t i, const View& view) {
    renderer.draw(scene, view.camera, settings, pass);
    std::vector<float> planes = pass.image.download();
    ImageF render = image_of({planes.data(), planes.size()}, pass.width, pass.height);
    if (on_view) on_view(i, view, render);
    if (trains_nowhere(view)) return;
    evaluation.has_exposures = evaluation.has_exposures || view.has_exposure();
    DrawnView next{view, std::move(planes), std::move(render)};
    if (options.appearance_of) next.appearance = options.appearance_of(view);
    if (view.has_exposure() && options.solved_appearance_of)
      next.solved_appearance = options.solved_appearance_of(view);
    drawn.push_back(std::move(next));
    if (drawn.size() == at_a_time) measure_drawn();
  });
  measure_drawn();
  if (options.metrics.is_perceptual && options.metrics.lpips)
    evaluation.lpips_source = options.metrics.lpips->source();
  take_means(evaluation);
  return evaluation;
}

}  // namespace gs
