// SPDX-License-Identifier: Apache-2.0
// The GPU memory that training takes at most: the sum over all of its buffers.
// docs/develop/architecture.md ("Memory") has the same as a table. On the CPU one figure for each
// Gaussian stands for them.
#pragma once

#include <cstddef>
#include <vector>

#include "gs_core/config/config.h"
#include "gs_core/scene.h"

namespace gs {

/// Before an array of so many bytes grows, the step's other buffers are released, so that its old
/// rows have room beside the new ones. Those of smaller ones are not worth the time.
inline constexpr std::size_t kBytesWorthReleasing = std::size_t(16) << 20;

/// Places for instances that a run ends up with for each Gaussian: 1.2 times those of the view with
/// the most. Trained scenes have 1.8 to 2.8 instances per Gaussian in the mean over their views
/// (docs/lab/2026-11-gpu-stages.md).
inline constexpr double kInstancePlaces = 3.5;

/// How a run's Gaussians become more. It decides what arrays hold in reserve.
enum class RowGrowth {
  none,      // as many as at the start
  reserved,  // the parameters have the memory of the last count from the start
  by_need,   // each array grows when it is full
};

/// The pictures of a run.
struct PictureSizes {
  double pixels = 0;               // of the largest
  double photo_bytes = 0;          // of all training photos with their masks
  double largest_photo_bytes = 0;  // of these
  double depth_pixels = 0;         // of all depth maps
  double normal_pixels = 0;        // of all normal maps
};
PictureSizes picture_sizes(const std::vector<View>& train_views);

/// What training takes memory for.
struct TrainingSize {
  double gaussians = 0;
  double pixels = 0;       // of the largest picture
  double photo_bytes = 0;  // of photos and masks on the GPU, resident and in flight
  double map_bytes = 0;    // of maps that teach, all of which stay on the GPU
  double instance_places = kInstancePlaces;  // for each Gaussian
  RowGrowth growth = RowGrowth::by_need;
  bool relocates = false;  // mcmc's row operations, in place of those that clone and split
  int batch = 1;           // photos of an update
  MomentStorage moments = MomentStorage::floats;
  bool has_time = false, has_filter = false;  // as in Gaussians
  bool has_sums = false;                      // over fragments, of the score
  bool has_score_pass = false;                // a pass of its own fills them, not the steps
  bool is_absolute = false;  // gradients of means are also summed as absolute values
  bool has_depth_maps = false;
  bool has_surface = false;  // steps with surface terms
  bool is_deterministic = false;
  bool is_by_pixel = false;  // render.order
};

/// That of a run with so many Gaussians at most.
TrainingSize training_size(const Config& config, const PictureSizes& pictures, double gaussians);

/// True where density control ends with density.max_gaussians Gaussians, as its method does.
bool rises_to_cap(const Config& config);

/// The Gaussians that a run starts with, from so many sparse points, of which it takes `most`; with
/// 0, from random ones.
double first_gaussians(const Config& config, std::size_t points, std::size_t most = kMostPoints);

/// The Gaussians that a run has for certain, if it starts with so many: those, or the number to
/// which it rises.
double certain_gaussians(const Config& config, double start);

/// The most bytes that a run has allocated on the GPU at a time.
double training_bytes(const TrainingSize& size);
/// Of training_bytes(), the parameters, moments and statistics of so many Gaussians, without any
/// reserve.
double state_bytes(const TrainingSize& size, double gaussians);
/// The RAM of a Gaussian of the usual parameters, kParameterBytes, in a run on the CPU, which keeps
/// gradients of all parameters as well: some 1,700 bytes, and a reserve.
inline constexpr double kGaussianBytesOnCpu = 2048, kParameterBytes = 236;
/// What optimizer.moments saves of it: the bytes by which moments are smaller than floats, and half
/// of that again, since arrays grow by halves.
constexpr double bytes_saved_by_moments(MomentStorage storage, double parameter_bytes) {
  const int of_number = moment_bytes(MomentStorage::floats) - moment_bytes(storage);
  return 1.5 * of_number * parameter_bytes / sizeof(float);
}

/// The number of Gaussians, at least 0, with which the run takes so many bytes.
double gaussians_that_fit(TrainingSize size, double bytes);

}  // namespace gs
