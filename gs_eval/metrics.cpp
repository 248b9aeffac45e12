// SPDX-License-Identifier: Apache-2.0
#include "gs_eval/metrics.h"

#include <algorithm>
#include <cmath>
#include <mutex>
#include <numbers>
#include <utility>
#include <vector>

#include "gs_core/error.h"
#include "gs_core/math/loss/photo_weight.h"
#include "gs_core/math/loss/ssim.h"
#include "gs_core/threads/parallel.h"
#include "gs_eval/color_correction.h"
#include "gs_eval/flip/flip.h"
#include "gs_eval/lpips/lpips.h"
#include "gs_eval/panorama_metrics.h"
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

/// What adds up to a mean.
struct Share {
  double sum = 0, weight = 0;

  double mean() const {
    GS_CHECK(weight > 0);
    return sum / weight;
  }
};

/// The shares of all rows, added up in order. rows(begin, end, shares) gives those of some rows.
template <class Rows>
Share sum_of_rows(int height, std::size_t at_a_time, Rows&& rows) {
  std::vector<Share> shares{std::size_t(height)};
  parallel_chunks(shares.size(), at_a_time, [&](std::size_t begin, std::size_t end) {
    rows(int(begin), int(end), &shares[begin]);
  });
  Share total;
  for (const Share& share : shares) total.sum += share.sum, total.weight += share.weight;
  return total;
}

constexpr std::size_t kRowsPerChunk = 16;

/// at(pixel, channel) gives the values.
template <class At>
double psnr_of(const ImageF& render, At&& at) {
  const std::size_t width = std::size_t(render.width);
  const auto add_rows = [&](int begin, int end, Share* shares) {
    for (int y = begin; y < end; ++y)
      for (std::size_t x = 0; x < width; ++x)
        for (int c = 0; c < 3; ++c) {
          const ComparedValue value = at(std::size_t(y) * width + x, c);
          shares[y - begin].sum += value.share * (value.x - value.y) * (value.x - value.y);
          shares[y - begin].weight += value.share;
        }
  };
  const double mse = sum_of_rows(render.height, kRowsPerChunk, add_rows).mean();
  return mse > 0 ? std::min(-10 * std::log10(mse), kIdenticalPsnr) : kIdenticalPsnr;
}

/// Arrays of the bands of SSIM, kept from one to the next: the system takes twice as long to give and
/// take their pages as the means under the window take.
class BandArrays {
 public:
  Buffer<float> take() {
    const std::scoped_lock lock(mutex_);
    if (idle_.empty()) return Buffer<float>();
    Buffer<float> array = std::move(idle_.back());
    idle_.pop_back();
    return array;
  }
  void give_back(Buffer<float> array) {
    const std::scoped_lock lock(mutex_);
    idle_.push_back(std::move(array));
  }

 private:
  std::mutex mutex_;
  std::vector<Buffer<float>> idle_;
};

/// Rows of a picture go through the window together with those that it reaches on both sides.
template <class At>
double ssim_of(const ImageF& render, BandArrays& arrays, At&& at) {
  constexpr std::size_t kRowsPerBand = 48;
  const std::size_t width = std::size_t(render.width);
  const auto add_rows = [&](int begin, int end, Share* shares) {
    const int first = std::max(begin - kSsimRadius, 0);
    const int last = std::min(end + kSsimRadius, render.height);
    const std::size_t plane = width * std::size_t(last - first), n = 3 * plane;
    const std::size_t above = width * std::size_t(first);
    Buffer<float> moments = arrays.take(), scratch = arrays.take();
    moments.resize_discard(5 * n);
    for (std::size_t i = 0; i < plane; ++i)
      for (int c = 0; c < 3; ++c) {
        const ComparedValue value = at(above + i, c);
        const float x = float(value.share * value.x), y = float(value.share * value.y);
        const float values[5] = {x, y, x * x, y * y, x * y};
        for (int k = 0; k < 5; ++k) moments[k * n + c * plane + i] = values[k];
      }
    window_means(moments.span(), 15, render.width, last - first, scratch);
    for (int y = begin; y < end; ++y)
      for (std::size_t x = 0; x < width; ++x)
        for (int c = 0; c < 3; ++c) {
          const std::size_t pixel = std::size_t(y) * width + x, i = c * plane + pixel - above;
          if (!(at(pixel, c).share > 0)) continue;
          shares[y - begin].sum +=
              ssim_index(WindowMeans<float>{moments[i], moments[n + i], moments[2 * n + i],
                                            moments[3 * n + i], moments[4 * n + i]});
          ++shares[y - begin].weight;
        }
    arrays.give_back(std::move(moments));
    arrays.give_back(std::move(scratch));
  };
  return sum_of_rows(render.height, kRowsPerBand, add_rows).mean();
}

// Makes `image` one of this size; its values are of no use.
void resize(ImageF& image, int width, int height, int channels) {
  if (image.width == width && image.height == height && image.channels == channels) return;
  image = ImageF(width, height, channels);
}

// `pictures` keep their memory from one view to the next.
template <class At>
PerceptualMetrics perceptual_of(const ImageF& render, bool is_weighted, Lpips* lpips,
                                ComparedPictures& pictures, At&& at) {
  resize(pictures.render, render.width, render.height, 3);
  resize(pictures.photo, render.width, render.height, 3);
  if (is_weighted)
    resize(pictures.weight, render.width, render.height, 1);
  else
    pictures.weight = {};
  const std::size_t width = std::size_t(render.width);
  parallel_for(render.pixels.size() / 3, kRowsPerChunk * width, [&](std::size_t pixel) {
    for (int c = 0; c < 3; ++c) {
      const ComparedValue value = at(pixel, c);
      pictures.render.pixels[3 * pixel + c] = float(value.share * value.x);
      pictures.photo.pixels[3 * pixel + c] = float(value.share * value.y);
      if (is_weighted) pictures.weight.pixels[pixel] = float(value.share);
    }
  });
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
                                   Appearance& appearance, BandArrays& arrays) {
  const ImageF shown = shown_image(planes, appearance);
  const auto values = values_under(shown, view, background, appearance);
  return {psnr_of(shown, values), ssim_of(shown, arrays, values)};
}

template <class At>
PictureMetrics corrected_metrics(const ImageF& render, BandArrays& arrays, At&& at) {
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
  return {psnr_of(render, corrected), ssim_of(render, arrays, corrected)};
}

// A view that is drawn. Its arrays keep their memory from one view to the next.
struct DrawnView {
  std::vector<float> planes;                                  // (3, H, W)
  ImageF render;                                              // the same, clamped
  std::unique_ptr<Appearance> appearance, solved_appearance;  // may be null
  ComparedPictures compared;                                  // scratch
  BandArrays bands;                                           // scratch

  void take(const RenderPass& pass) {
    planes.resize(pass.image.size());
    if (!planes.empty())
      pass.image.memory().download(planes.data(), pass.image.data(), pass.image.size_bytes());
    resize(render, pass.width, pass.height, 3);
    const std::size_t plane = planes.size() / 3;
    parallel_for(plane, kRowsPerChunk * std::size_t(pass.width), [&](std::size_t i) {
      for (std::size_t c = 0; c < 3; ++c)
        render.pixels[3 * i + c] = clamp_to(planes[c * plane + i], 0.0f, 1.0f);
    });
  }
};

// What is measured of a view with its photo.
ViewMetrics measured(const View& view, DrawnView& drawn, const Vec3f& background,
                     const EvaluationOptions& options) {
  const ImageF& render = drawn.render;
  const Planes planes{drawn.planes.data(), render.width, render.height};
  check_sizes(render, view.photo);
  const auto perceptual = [&](const ImageF& picture, const auto& values) {
    return perceptual_of(picture, view.has_untrained_pixels(), options.metrics.lpips,
                         drawn.compared, values);
  };
  const auto as_it_is = values_of(render, view, background, Vec3f(1));
  ViewMetrics metrics{view.name, psnr_of(render, as_it_is), ssim_of(render, drawn.bands, as_it_is)};
  metrics.time = view.camera.time;
  if (options.metrics.is_perceptual) metrics.perceptual = perceptual(render, as_it_is);
  metrics.perceptual_exposure = metrics.perceptual;
  if (options.is_corrected) metrics.corrected = corrected_metrics(render, drawn.bands, as_it_is);
  if (drawn.appearance)
    metrics.photometric =
        photometric_metrics(planes, view, background, *drawn.appearance, drawn.bands);
  if (view.has_exposure()) {
    const auto take = [&](const ImageF& exposed, const auto& values) {
      metrics.psnr_exposure = psnr_of(exposed, values);
      metrics.ssim_exposure = ssim_of(exposed, drawn.bands, values);
      if (options.metrics.is_perceptual) metrics.perceptual_exposure = perceptual(exposed, values);
    };
    if (drawn.solved_appearance) {
      const ImageF exposed = shown_image(planes, *drawn.solved_appearance);
      take(exposed, values_under(exposed, view, background, *drawn.solved_appearance));
    } else {
      const ImageF exposed =
          image_of({planes.data, render.pixels.size()}, planes.width, planes.height, view.exposure);
      take(exposed, values_of(exposed, view, background, view.exposure));
    }
  }
  return metrics;
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
  const auto panoramas =
      double(std::count_if(evaluation.views.begin(), evaluation.views.end(),
                           [](const ViewMetrics& view) { return view.panorama.has_value(); }));
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
    if (!view.panorama) continue;
    if (!evaluation.panorama) evaluation.panorama = PanoramaMetrics();
    evaluation.panorama->psnr += view.panorama->psnr / panoramas;
    evaluation.panorama->ssim += view.panorama->ssim / panoramas;
    evaluation.panorama->ws_psnr += view.panorama->ws_psnr / panoramas;
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
  BandArrays arrays;
  return ssim_of(render, arrays, plain_values(render, photo));
}

PerceptualMetrics perceptual_metrics(const ImageF& render, const Image8& photo) {
  check_sizes(render, photo);
  ComparedPictures pictures;
  return perceptual_of(render, false, nullptr, pictures, plain_values(render, photo));
}

double psnr(const ImageF& render, const View& view, const Vec3f& background) {
  check_sizes(render, view.photo);
  const ImageF exposed = under_exposure(render, view.exposure);
  return psnr_of(exposed, values_of(exposed, view, background, view.exposure));
}

double ws_psnr(const ImageF& render, const View& panorama, const Vec3f& background) {
  check_sizes(render, panorama.photo);
  const auto values = values_of(render, panorama, background, Vec3f(1));
  return psnr_of(render, [&](std::size_t pixel, int c) {
    ComparedValue value = values(pixel, c);
    const double row = double(pixel / std::size_t(render.width));
    value.share *= std::cos(((row + 0.5) / render.height - 0.5) * std::numbers::pi);
    return value;
  });
}

double ssim(const ImageF& render, const View& view, const Vec3f& background) {
  check_sizes(render, view.photo);
  const ImageF exposed = under_exposure(render, view.exposure);
  BandArrays arrays;
  return ssim_of(exposed, arrays, values_of(exposed, view, background, view.exposure));
}

PerceptualMetrics perceptual_metrics(const ImageF& render, const View& view,
                                     const Vec3f& background) {
  check_sizes(render, view.photo);
  const ImageF exposed = under_exposure(render, view.exposure);
  ComparedPictures pictures;
  return perceptual_of(exposed, view.has_untrained_pixels(), nullptr, pictures,
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
  Evaluation evaluation;
  RenderPass pass(renderer.memory());
  DrawnView drawn;
  for_each_with_photo(views, views.size(), [&](std::size_t i, const View& view) {
    renderer.draw(scene, view.camera, settings, pass);
    drawn.take(pass);
    if (on_view) on_view(i, view, drawn.render);
    if (view.trains_nowhere()) return;
    evaluation.has_exposures = evaluation.has_exposures || view.has_exposure();
    const bool is_solved = view.has_exposure() && options.solved_appearance_of;
    drawn.appearance = options.appearance_of ? options.appearance_of(view) : nullptr;
    drawn.solved_appearance = is_solved ? options.solved_appearance_of(view) : nullptr;
    evaluation.views.push_back(measured(view, drawn, settings.background, options));
    if (view.panorama && options.metrics.is_perceptual)
      evaluation.views.back().panorama = panorama_metrics(renderer, scene, view, settings, pass);
  });
  if (options.metrics.is_perceptual && options.metrics.lpips)
    evaluation.lpips_source = options.metrics.lpips->source();
  take_means(evaluation);
  return evaluation;
}

}  // namespace gs
