// SPDX-License-Identifier: Apache-2.0
// The number of Gaussians that fit into memory: the meaning of --max-gaussians auto.
#pragma once

#include "gs_core/scene.h"
#include "gs_train/training_model.h"

namespace gs {

/// The number of Gaussians that a backend can train with `free_bytes`, when its photos are loaded
/// already, its pictures have `pixels` pixels, and `present` Gaussians are part of the memory in
/// use.
///
///   (0.85 free - 256 pixels + 708 present) / 2048     at least what is present, at most 2^28 - 1
///
/// bytes of one Gaussian   parameters and two moments 3 * 236, half of that again since arrays grow
///                         by halves, statistics 8, splat and sorting about 150, eight instances in
///                         a view about 320, and scratch for gathering rows about 300; on the CPU,
///                         gradients 236 instead of a part of the scratch
/// bytes of one pixel      picture, its gradient, the loss's moments and derivatives,
///                         last instances
std::int64_t gaussians_for(std::size_t free_bytes, std::size_t pixels, std::size_t present);

/// The same for a scene whose photos are loaded, a model of it, and the memory of that model. Logs
/// the number.
std::int64_t affordable_gaussians(const Scene& scene, const TrainingModel& model,
                                  const Memory& memory);

}  // namespace gs
