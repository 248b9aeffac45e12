// SPDX-License-Identifier: Apache-2.0
// Density control: where Gaussians are added and removed while training.
#pragma once

#include "gs_core/config.h"
#include "gs_train/backend.h"

namespace gs {

/// Adaptive density control (Kerbl et al. 2023, Sec. 5.2) with the config's thresholds.
class DensityControl {
 public:
  DensityControl(const Config& config, float scene_extent);

  /// Clones, splits and prunes by the statistics since the last call. `prune_large` also removes Gaussians
  /// that are huge against the scene.
  RefineReport refine(TrainingModel& model, Backend& backend, int step, bool prune_large) const;
  /// Lowers all opacities, so that only those that the photos ask for come back.
  void reset_opacity(TrainingModel& model, Backend& backend) const;
  /// From now on no growth beyond so many, nor beyond the config's cap; 0: as the config says.
  void set_growth_cap(std::int64_t most);
  std::int64_t growth_cap() const { return growth_cap_; }

 private:
  AdaptiveRules rules_;
  float prune_scale_;  // world units
  std::int64_t config_cap_, growth_cap_ = 0;  // Gaussians; 0: none
  Random random_;
};

}  // namespace gs
