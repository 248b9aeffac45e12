// SPDX-License-Identifier: Apache-2.0
#include "gs_app/experiment/tables/metrics.h"

namespace gs {

const std::vector<Metric>& all_metrics() {
  constexpr double kMiB = 1 << 20;
  static const std::vector<Metric> metrics = {
      {"psnr", "PSNR / dB", true, 1, 2},
      {"ssim", "SSIM", true, 1, 4},
      {"flip", "FLIP", true, 1, 4},
      {"lpips", "LPIPS", true, 1, 4},
      {"psnr_photometric", "predicted PSNR / dB", true, 1, 2},
      {"ssim_photometric", "predicted SSIM", true, 1, 4},
      {"psnr_exposure", "solved PSNR / dB", true, 1, 2},
      {"ssim_exposure", "solved SSIM", true, 1, 4},
      {"psnr_cc", "fitted PSNR / dB", true, 1, 2},
      {"ssim_cc", "fitted SSIM", true, 1, 4},
      {"psnr_panorama", "panorama PSNR / dB", true, 1, 2},
      {"ws_psnr", "WS-PSNR / dB", true, 1, 2},
      {"ssim_panorama", "panorama SSIM", true, 1, 4},
      {"depth_error", "depth error", true, 1, 4},
      {"normal_angle", "normals / degrees", true, 1, 1},
      {"num_gaussians", "Gaussians", false, 1, 0},
      {"train_seconds", "training / s", false, 1, 1},
      {"peak_host_bytes", "memory / MiB", false, kMiB, 0},
      {"peak_gpu_bytes", "GPU memory / MiB", false, kMiB, 0},
      {"forecast_gpu_bytes", "its forecast / MiB", false, kMiB, 0},
  };
  return metrics;
}

std::optional<double> value_of(const Json& results, const Metric& metric) {
  if (!results.is_object()) return std::nullopt;
  const Json* holder = &results;
  if (metric.is_of_views) {
    const bool has_test = results.contains("test") && results["test"].is_object();
    const char* split = has_test ? "test" : "train";
    if (!results.contains(split)) return std::nullopt;
    holder = &results.at(split);
  }
  if (!holder->is_object() || !holder->contains(metric.key) || !holder->at(metric.key).is_number())
    return std::nullopt;
  return holder->at(metric.key).get<double>();
}

}  // namespace gs
