// SPDX-License-Identifier: Apache-2.0
// An estimate of the memory, time and disk of a run, before it starts.
#pragma once

#include <cstddef>
#include <string>
#include <vector>

#include "gs_core/config/config.h"

namespace gs {

/// The numbers of a scene that the forecast needs.
struct SceneSize {
  double photo_bytes = 0;         // of all photos with their masks, decoded
  double loaded_bytes = 0;        // of these, in memory already
  double megapixels = 0;          // of a photo, in the mean
  std::size_t points = 0;         // of the model; 0: training starts from random ones
  std::size_t start = 0;          // Gaussians of a model that training starts from instead; 0: none
  double train_share = 1;         // of the photos, those that are trained on
  double depth_maps = 0;          // photos that have one
  double normal_maps = 0;         // photos that have one
  double largest_megapixels = 0;  // of a photo; 0: as in the mean

  /// Of all photos that are trained on.
  double training_pixels() const { return train_share * photo_bytes / 3; }
};

/// The device of the run.
struct ForecastDevice {
  bool is_gpu = false;
  std::size_t free_bytes = 0;  // of its memory; 0: unknown
};

struct Forecast {
  std::string text;                   // in a sentence
  std::vector<std::string> warnings;  // what will not fit, each with a remedy
};

/// Gaussians at the end of a run, within a factor of two on our scenes:
///
///   start + (full - start) sqrt(min(steps / 30000, 1))    adaptive, at most the cap
///   the cap                                               mcmc; budgeted with a curve to it
///
/// start   points of the model, `most` of them, or random points; at most the cap
/// full    after 30,000 steps: 25 start, but at most a million and at least 2 start
/// Runs too short for a refinement end with `start`.
double expected_gaussians(const Config& config, std::size_t points, std::size_t most = kMostPoints);
/// The same for a run that starts from a model with so many Gaussians: it keeps all of them, also
/// above the cap.
double expected_gaussians_from_model(const Config& config, std::size_t start);

/// Whether to divide a scene into blocks (docs/method/blocks.md).
struct BlockAdvice {
  std::size_t blocks = 1;  // 1: one run holds it
  std::string text;        // in a sentence; empty where the memory of the device is unknown
};

/// Compares the Gaussians that a run would have, if nothing but density.max_gaussians limited them,
/// with those that fit into the free memory.
BlockAdvice advice_on_blocks(const Config& config, const SceneSize& scene,
                             const ForecastDevice& device);

/// Compares the needs of a run with the free memory of `device` and of the host. Times are given
/// for a GPU only: a CPU's differ too much.
Forecast forecast(const Config& config, const SceneSize& scene, const ForecastDevice& device);

}  // namespace gs
