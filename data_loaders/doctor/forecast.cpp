// SPDX-License-Identifier: Apache-2.0
#include "data_loaders/doctor/forecast.h"

#include <spdlog/fmt/fmt.h>

#include <algorithm>

#include "gs_core/bytes.h"
#include "gs_core/io/host_ram.h"

namespace gs {
namespace {

// Bytes per Gaussian, as measured on the CUDA backend: parameters, two moments, statistics and the splats of a view;
// and in a PLY of SH degree 3.
constexpr double kBytesPerGaussian = 1700, kPlyBytesPerGaussian = 248;
constexpr double kForecastGaussians = 1e6;
// Seconds of 30,000 steps on one H200, fitted to docs/benchmarks.md, "GPU: training": a share for themselves, for a million
// Gaussians, and for a million pixels of a photo.
constexpr double kSecondsOfSteps = 6, kSecondsOfMillion = 35, kSecondsOfMegapixel = 13;

std::string size_text(double bytes) {
  return bytes < 0.1 * kBytesPerGib ? fmt::format("{:.0f} MiB", bytes * 1024 / kBytesPerGib)
                                    : fmt::format("{:.1f} GiB", bytes / kBytesPerGib);
}

}  // namespace

std::string forecast(const Config& config, double photo_bytes, double megapixels) {
  const double ram = double(photo_ram_bytes(config.dataset)),
               cap = double(config.density.max_gaussians);
  const double gaussians = cap > 0 ? cap : kForecastGaussians;
  const double on_gpu = std::min(photo_bytes, double(config.train.photo_gib) * kBytesPerGib);
  const double seconds =
      (kSecondsOfSteps + kSecondsOfMillion * gaussians * 1e-6 + kSecondsOfMegapixel * megapixels) *
      double(config.train.iterations) * config.train.steps_scaler / 30000;
  return fmt::format(
      "photos take {} of RAM{}; training {:.2g} million Gaussians ({}) takes some {} of GPU memory "
      "and, on an H200, {:.0f} s; each saved model takes {} of disk",
      size_text(std::min(photo_bytes, ram)),
      photo_bytes > ram ? fmt::format(" (of {}: the others are decoded when it is their turn)",
                                      size_text(photo_bytes))
                        : "",
      gaussians * 1e-6, cap > 0 ? "the cap" : "few scenes need more",
      size_text(on_gpu + gaussians * kBytesPerGaussian), seconds,
      size_text(gaussians * kPlyBytesPerGaussian));
}

}  // namespace gs
