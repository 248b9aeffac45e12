// SPDX-License-Identifier: Apache-2.0
#include "gs_train/density/gaussian_budget.h"

#include <algorithm>

#include "gs_core/bytes.h"
#include "gs_core/log.h"
#include "gs_render/render_pass.h"

namespace gs {
namespace {

constexpr double kShareOfFree = 0.85;      // the rest is for other programs and for fragmentation
constexpr double kBytesOfGaussian = 2048;  // some 1,700 in a run (gemsplat doctor), and a reserve
constexpr double kBytesOfPixel = 256;
constexpr double kBytesOfParameters = 236, kBytesOfTimeParameters = 24, kBytesOfSlope = 12;
constexpr double kBytesOfStatistics = 8;
constexpr double kTimeParametersAtATime = 6;  // their moments, gradients and scratch with them
constexpr double kSpare = 1.5;                // arrays grow by halves

}  // namespace

std::int64_t gaussians_for(const RoomForGaussians& room) {
  const double time =
      (room.has_time ? kBytesOfTimeParameters : 0) + (room.has_slope ? kBytesOfSlope : 0);
  const double parameters = kBytesOfParameters + time;
  const double sums = room.batch > 1 ? parameters + kBytesOfStatistics : 0;
  const double saved = room.has_codes ? parameters : 0;  // codes are half as large as floats
  const double of_gaussian =
      kBytesOfGaussian + kTimeParametersAtATime * time + sums - kSpare * saved;
  const double of_present = 3 * parameters - saved;  // and moments: what is no longer free
  const double present = double(room.present);
  const double usable = kShareOfFree * double(room.free_bytes) -
                        kBytesOfPixel * double(room.pixels) + of_present * present;
  return std::int64_t(
      std::clamp(usable / of_gaussian, std::max(present, 1.0), double(kMostGaussians - 1)));
}

std::int64_t affordable_gaussians(const Scene& scene, const TrainingModel& model,
                                  const Memory& memory, int batch, MomentForm moments) {
  std::size_t pixels = 0;
  for (const View& view : scene.train_views)
    pixels = std::max(pixels, std::size_t(view.camera.width) * std::size_t(view.camera.height));
  const std::size_t free = memory.free_bytes();
  const std::int64_t count =
      gaussians_for({free, pixels, model.count(), model.gaussians.has_time, batch,
                     model.gaussians.has_slope, moments == MomentForm::compact});
  log_info("there is memory for {:.2f} million Gaussians at most ({:.1f} GiB are free)",
           1e-6 * double(count), double(free) / kBytesPerGib);
  return count;
}

}  // namespace gs
