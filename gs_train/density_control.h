// SPDX-License-Identifier: Apache-2.0
// Density control: where Gaussians are added, moved and removed while training. docs/extending.md shows how to add a
// strategy.
#pragma once

#include <memory>
#include <string>
#include <vector>

#include "gs_core/config.h"
#include "gs_train/backend.h"
#include "gs_train/schedule.h"

namespace gs {

/// A strategy of density control. What it draws depends on seed and step alone, and what it remembers lies in the
/// TrainingModel, so that a resumed run goes on as if it had never stopped.
class DensityControl {
 public:
  virtual ~DensityControl() = default;
  /// What it asks of step `step`.
  virtual DensityStep of_step(int step) const = 0;
  /// Adds, moves and removes Gaussians after step `step`, in the steps in which there is something to do.
  virtual RefineReport after_step(TrainingModel& model, Backend& backend, int step) = 0;
};

/// The strategy that config.density.strategy names; config.density.max_gaussians is a number. Throws UsageError.
std::unique_ptr<DensityControl> make_density_control(const Config& config, const Schedule& schedule,
                                                     float scene_extent);

/// Their names.
std::vector<std::string> density_strategies();

/// The strategies, one file each.
using MakeDensityControl = std::unique_ptr<DensityControl>(const Config&, const Schedule&,
                                                           float scene_extent);
MakeDensityControl make_adaptive_control;  // density_adaptive.cpp
MakeDensityControl make_mcmc_control;      // density_mcmc.cpp

}  // namespace gs
