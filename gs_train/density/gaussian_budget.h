// SPDX-License-Identifier: Apache-2.0
// The number of Gaussians that fit into memory: the meaning of --max-gaussians auto.
#pragma once

#include "gs_core/config/config_words.h"
#include "gs_core/forecast/training_memory.h"
#include "gs_core/scene.h"
#include "gs_train/training_model.h"

namespace gs {

/// What decides how many Gaussians fit.
struct GaussianBudget {
  std::size_t free_bytes;  // when the photos are loaded
  std::size_t pixels;      // of the largest picture
  std::size_t present;     // Gaussians, which are part of the memory in use
  bool has_time = false;   // they have a place in time
  int batch = 1;           // photos of one update
  MomentStorage moments = MomentStorage::floats;
};

/// The number of Gaussians that the CPU backend can train.
///
///   (0.85 free - 256 pixels + 708 present) / 2048     at least what is present, at most 2^28 - 1
///
/// bytes of one Gaussian   parameters, two moments and gradients 4 * 236, half of that again since
///                         arrays grow, statistics 8, splat and sorting about 150, eight instances
///                         in a view about 320
///   half moments          354 less, and half of that again
///   in time               six more parameters: 24 bytes where there are 236
///   in batches            sums of the gradients 236, and of the statistics 8
///   scores                sums over fragments 16: what the 2048 have in reserve
///   3D filter             one number, 4: of the same reserve
/// bytes of one pixel      picture, its gradient, the loss's moments and derivatives,
///                         last instances
std::int64_t gaussians_for(const GaussianBudget& budget);

/// The number of Gaussians that a GPU can train: with so many, training_bytes() is 90 % of what is
/// free, and of the `present` Gaussians, whose parameters and moments are in use. At least what is
/// present, at most 2^28 - 1. Of `size` the count does not matter.
std::int64_t gaussians_on_gpu(const TrainingSize& size, std::size_t free_bytes,
                              std::size_t present);

/// The same for a scene whose photos are loaded, a model of it, the memory of that model, and the
/// settings of the run, whose density.max_gaussians does not count. Logs the number.
std::int64_t affordable_gaussians(const Scene& scene, const TrainingModel& model,
                                  const Memory& memory, const Config& config);

}  // namespace gs
