// SPDX-License-Identifier: Apache-2.0
#include "gs_train/density/gaussian_budget.h"

#include <algorithm>

#include "gs_core/system/bytes.h"
#include "gs_core/system/log.h"
#include "gs_render/render_pass.h"

namespace gs {
namespace {

constexpr double kShareOfFree = 0.85;  // the rest is for other programs and for fragmentation
constexpr double kShareOfGpu = 0.9;    // training_bytes() is within a tenth of the truth
constexpr double kBytesOfPixel = 256;
constexpr double kBytesOfTimeParameters = 24;
constexpr double kBytesOfStatistics = 8;
constexpr double kTimeParametersAtATime = 6;  // their moments, gradients and scratch with them

}  // namespace

std::int64_t gaussians_for(const GaussianBudget& budget) {
  const double time = budget.has_time ? kBytesOfTimeParameters : 0;
  const double parameters = kParameterBytes + time;
  const double sums = budget.batch > 1 ? parameters + kBytesOfStatistics : 0;
  const double of_gaussian = kGaussianBytesOnCpu + kTimeParametersAtATime * time + sums -
                             bytes_saved_by_moments(budget.moments, parameters);
  // Parameters and moments are in use.
  const double of_present = (1 + moment_bytes(budget.moments) / double(sizeof(float))) * parameters;
  const double present = double(budget.present);
  const double usable = kShareOfFree * double(budget.free_bytes) -
                        kBytesOfPixel * double(budget.pixels) + of_present * present;
  return std::int64_t(
      std::clamp(usable / of_gaussian, std::max(present, 1.0), double(kMostGaussians - 1)));
}

std::int64_t gaussians_on_gpu(const TrainingSize& size, std::size_t free_bytes,
                              std::size_t present) {
  const double usable = kShareOfGpu * double(free_bytes) + state_bytes(size, double(present));
  return std::int64_t(std::clamp(gaussians_that_fit(size, usable), std::max(double(present), 1.0),
                                 double(kMostGaussians - 1)));
}

std::int64_t affordable_gaussians(const Scene& scene, const TrainingModel& model,
                                  const Memory& memory, const Config& config) {
  PictureSizes pictures = picture_sizes(scene.train_views);
  const std::size_t free = memory.free_bytes();
  std::int64_t count;
  if (&memory == &host_memory()) {
    count = gaussians_for({free, std::size_t(pictures.pixels), model.count(),
                           model.gaussians.has_time, config.train.batch, config.optimizer.moments});
  } else {
    TrainingSize size = training_size(config, pictures, 0);
    size.growth = RowGrowth::by_need;
    size.has_time = model.gaussians.has_time;
    size.has_filter = model.gaussians.has_filter;
    // Photos that stay on the GPU are there.
    size.photo_bytes =
        std::max(size.photo_bytes - double(config.train.photo_gib) * kBytesPerGib, 0.0);
    count = gaussians_on_gpu(size, free, model.count());
  }
  log_info("there is memory for {:.2f} million Gaussians at most ({:.1f} GiB are free)",
           1e-6 * double(count), double(free) / kBytesPerGib);
  return count;
}

}  // namespace gs
