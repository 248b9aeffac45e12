// SPDX-License-Identifier: Apache-2.0
#include "data_loaders/doctor/forecast.h"

#include <spdlog/fmt/fmt.h>

#include <algorithm>
#include <cmath>
#include <utility>

#include "gs_core/config/scene_settings.h"
#include "gs_core/forecast/training_memory.h"
#include "gs_core/memory.h"
#include "gs_core/system/bytes.h"
#include "gs_core/system/host_ram.h"

namespace gs {
namespace {

constexpr double kPlyBytes = 248;  // per Gaussian of SH degree 3

// Growth of adaptive density control in 30,000 steps (docs/lab/2026-11-gpu-training.md).
constexpr double kFullSteps = 30000;
constexpr double kGrowth = 25;        // fox_640: 24 times its points, south_building: 27 times
constexpr double kOrdinaryEnd = 1e6;  // few scenes end with more, unless they start with more
constexpr double kLeastGrowth = 2;
constexpr double kFirstGrowth = 300;  // steps; no earlier refinement in any run (gs_train/schedule)

// Seconds of 30,000 steps on one H200, fitted to docs/lab/2026-11-gpu-training.md: a constant, a
// share per million Gaussians, and one per million pixels of a photo.
constexpr double kSecondsOfSteps = 6, kSecondsOfMillion = 35, kSecondsOfMegapixel = 13;

constexpr double kShareOfFree = 0.9;  // other programs need memory, too

double steps_of(const Config& config) {
  return double(config.train.iterations) * config.train.steps_scaler;
}

std::string size_text(double bytes) {
  return bytes < 0.1 * kBytesPerGib ? fmt::format("{:.0f} MiB", bytes * 1024 / kBytesPerGib)
                                    : fmt::format("{:.1f} GiB", bytes / kBytesPerGib);
}

std::string count_text(double gaussians) {
  if (gaussians < 1e5) return fmt::format("{:.0f},000", std::max(gaussians * 1e-3, 1.0));
  if (gaussians < 1e8) return fmt::format("{:.2g} million", gaussians * 1e-6);
  return fmt::format("{:.0f} million", gaussians * 1e-6);
}

/// The remedy for a model that does not fit: at most so many Gaussians do.
std::string cap_advice(double fitting) {
  const double most = std::floor(fitting / 1e4) * 1e4;
  return most > 0 ? fmt::format("cap the Gaussians with --max-gaussians {:.0f}", most)
                  : "make the photos smaller with -r 2";
}

/// Bytes that photos may take in the memory of the GPU, or of the host.
double room_for_photos(const Config& config, bool on_gpu) {
  return on_gpu ? double(config.train.photo_gib) * kBytesPerGib
                : double(photo_ram_bytes(double(config.dataset.photo_ram_gib)));
}

/// What training takes of a GPU's memory for so many Gaussians.
TrainingSize size_on_gpu(const Config& config, const SceneSize& scene, double gaussians) {
  PictureSizes pictures;
  pictures.pixels = 1e6 * std::max(scene.megapixels, scene.largest_megapixels);
  pictures.photo_bytes = scene.train_share * scene.photo_bytes;
  pictures.largest_photo_bytes = 4 * pictures.pixels;
  pictures.depth_pixels = 1e6 * scene.megapixels * scene.train_share * scene.depth_maps;
  pictures.normal_pixels = 1e6 * scene.megapixels * scene.train_share * scene.normal_maps;
  return training_size(config, pictures, gaussians);
}

// Gaussians of a block beyond its share of the scene: its borders, and points outside of them
constexpr double kOverlapOfBlocks = 1.5;

constexpr std::size_t kAnyPhotos = 1;  // whatever their number, the run is long enough to grow

// What a step and a measurement on the CPU hold for each pixel of the largest picture: 164 bytes for
// the picture, its gradient, the photo and windowed moments, and 156 for a picture that is measured.
constexpr double kPixelBytesOnCpu = 164 + 156;

double picture_bytes_on_cpu(const SceneSize& scene) {
  return kPixelBytesOnCpu * 1e6 * std::max(scene.megapixels, scene.largest_megapixels);
}

double bytes_on_cpu(const Config& config) {
  return kGaussianBytesOnCpu - bytes_saved_by_moments(config.optimizer.moments, kParameterBytes);
}

/// The config of a run that has as many Gaussians as the scene asks for.
Config without_limits_of_one_run(Config config, const SceneSize& scene) {
  DensityConfig& density = config.density;
  density.max_gaussians = std::max<std::int64_t>(density.max_gaussians, 0);
  return resolved_config(std::move(config), {scene.points, kAnyPhotos, scene.training_pixels()});
}

}  // namespace

BlockAdvice advice_on_blocks(const Config& config, const SceneSize& scene,
                             const ForecastDevice& device) {
  const double free = double(device.is_gpu ? device.free_bytes : host_memory().free_bytes());
  if (free == 0 || scene.points == 0) return {};
  const double photos = std::min(scene.photo_bytes, room_for_photos(config, device.is_gpu));
  const double usable = kShareOfFree * free;
  const double fit =
      device.is_gpu ? std::max(gaussians_that_fit(size_on_gpu(config, scene, 0), usable),
                               gaussians_that_fit(size_on_gpu(config, SceneSize{}, 0), usable / 4))
                    : std::max(usable - photos - picture_bytes_on_cpu(scene), usable / 4) /
                          bytes_on_cpu(config);
  const double wanted =
      expected_gaussians(without_limits_of_one_run(config, scene), scene.points, scene.points);
  if (wanted <= fit)
    return {1, fmt::format("one run holds the scene: of about {} Gaussians that fit into memory it "
                           "needs {}",
                           count_text(fit), count_text(wanted))};
  const auto blocks = std::size_t(std::ceil(kOverlapOfBlocks * wanted / fit));
  return {blocks,
          fmt::format("about {} Gaussians are more than the {} that fit into memory: divide "
                      "the scene with `gemsplat partition SCENE -o OUT --blocks {}`",
                      count_text(wanted), count_text(fit), blocks)};
}

double expected_gaussians(const Config& config, std::size_t points, std::size_t most) {
  const double cap = double(config.density.max_gaussians);  // 0 or less: none yet
  const double start = first_gaussians(config, points, most);
  const double steps = steps_of(config);
  if (steps <= std::min(double(config.density.from_step), kFirstGrowth)) return start;
  if (rises_to_cap(config)) return cap;
  const double end = std::max(std::min(kGrowth * start, kOrdinaryEnd), kLeastGrowth * start);
  const double gaussians = start + (end - start) * std::sqrt(std::min(steps / kFullSteps, 1.0));
  return cap > 0 ? std::min(gaussians, cap) : gaussians;
}

double expected_gaussians_from_model(const Config& config, std::size_t start) {
  if (start == 0) return 0;
  return std::max(double(start), expected_gaussians(config, start, start));
}

Forecast forecast(const Config& config, const SceneSize& scene, const ForecastDevice& device) {
  const double budget = room_for_photos(config, false);
  const double gaussians = scene.start > 0 ? expected_gaussians_from_model(config, scene.start)
                                           : expected_gaussians(config, scene.points);
  const double photos_in_ram = std::min(scene.photo_bytes, budget);
  const TrainingSize size = size_on_gpu(config, scene, gaussians);
  const double on_gpu = training_bytes(size);
  const double of_pictures = device.is_gpu ? 0 : picture_bytes_on_cpu(scene);
  const double on_cpu = gaussians * bytes_on_cpu(config) + of_pictures;
  const double free_ram = double(host_memory().free_bytes());
  const double free_on_gpu = double(device.free_bytes);
  const double new_in_ram =
      std::max(photos_in_ram - scene.loaded_bytes, 0.0) + (device.is_gpu ? 0 : on_cpu);

  Forecast result;
  result.text = fmt::format(
      "about {} Gaussians{}; photos take {} of RAM{}; ", count_text(gaussians),
      config.density.max_gaussians > 0
          ? fmt::format(" (at most {})", count_text(double(config.density.max_gaussians)))
          : "",
      size_text(photos_in_ram),
      scene.photo_bytes > budget
          ? fmt::format(" (of {}: the other photos are decoded just before their turn)",
                        size_text(scene.photo_bytes))
          : "");
  const double seconds = (kSecondsOfSteps + kSecondsOfMillion * gaussians * 1e-6 +
                          kSecondsOfMegapixel * scene.megapixels) *
                         steps_of(config) / kFullSteps;
  if (device.is_gpu)
    result.text += fmt::format(
        "training takes about {} of GPU memory{} and, on an H200, {:.0f} s; ", size_text(on_gpu),
        device.free_bytes ? fmt::format(" ({} are free)", size_text(free_on_gpu)) : "", seconds);
  else
    result.text += fmt::format("training on the CPU takes about {} of RAM ({} are free); ",
                               size_text(on_cpu), size_text(free_ram));
  result.text += fmt::format("each saved model takes {} of disk", size_text(gaussians * kPlyBytes));

  if (device.is_gpu && device.free_bytes && on_gpu > kShareOfFree * free_on_gpu)
    result.warnings.push_back(fmt::format(
        "the GPU has {} free and the run may need {}; {}", size_text(free_on_gpu),
        size_text(on_gpu), cap_advice(gaussians_that_fit(size, kShareOfFree * free_on_gpu))));
  if (new_in_ram > kShareOfFree * free_ram)
    result.warnings.push_back(
        fmt::format("{} of RAM are free and the run may need {}; {}", size_text(free_ram),
                    size_text(new_in_ram),
                    device.is_gpu || photos_in_ram > on_cpu
                        ? std::string("let fewer photos stay decoded with --photo-ram GIB")
                        : cap_advice((kShareOfFree * free_ram - photos_in_ram - of_pictures) /
                                     bytes_on_cpu(config))));
  return result;
}

}  // namespace gs
