// SPDX-License-Identifier: Apache-2.0
// Density control: where Gaussians are added, moved and removed while training, as a method of
// gs_core/density says. docs/develop/extending.md shows how to add one.
#pragma once

#include <algorithm>
#include <functional>
#include <memory>
#include <utility>

#include "gs_core/config/config.h"
#include "gs_train/backend.h"
#include "gs_train/schedule.h"

namespace gs {

/// The photos of a run, of which a score pass draws some.
struct ScorePhotos {
  std::size_t count = 0;
  /// One of them, as the step would train on it.
  std::function<TrainingPhoto(std::size_t photo, int step)> photo;
};

/// Density control of a run. Its random draws depend on seed and step alone, and its memory is
/// in the TrainingModel, so that a resumed run continues as if it had never stopped.
class DensityControl {
 public:
  /// `config_cap`: the number of Gaussians at which growth ends; 0: no cap.
  explicit DensityControl(std::int64_t config_cap) : config_cap_(config_cap) {}
  virtual ~DensityControl() = default;
  /// What it adds to step `step`.
  virtual DensityStep of_step(int step) const = 0;
  /// Adds, moves and removes Gaussians after step `step`. It is called after every step and acts in
  /// some of them.
  virtual RefineReport after_step(TrainingModel& model, Backend& backend, int step) = 0;

  /// Lowers the cap to `most` Gaussians from now on; 0: the cap is that of the config.
  void set_growth_cap(std::int64_t most) { growth_cap_ = most; }
  std::int64_t growth_cap() const { return growth_cap_; }
  /// The photos that a score pass draws from. A control whose method has none needs none.
  void set_photos(ScorePhotos photos) { photos_ = std::move(photos); }
  /// From now on Gaussians outside of the region do not grow.
  void set_region(const Region& region) { region_ = region; }

 protected:
  /// The lower one of both caps; 0: none.
  std::int64_t most_gaussians() const {
    return config_cap_ > 0 && growth_cap_ > 0 ? std::min(config_cap_, growth_cap_)
                                              : std::max(config_cap_, growth_cap_);
  }
  const Region& region() const { return region_; }
  const ScorePhotos& photos() const { return photos_; }

 private:
  std::int64_t config_cap_, growth_cap_ = 0;  // Gaussians; 0: none
  Region region_;
  ScorePhotos photos_;
};

/// The control of the method that config.density.strategy names. config.density.max_gaussians is not
/// kAutoCount any more. Throws UsageError.
std::unique_ptr<DensityControl> make_density_control(const Config& config, const Schedule& schedule,
                                                     float scene_extent);

/// The weights of the numbers of Gaussians in the loss, which hold for every method; those of
/// space and time only in a scene that moves.
Regularizers regularizers_of(const Config& config);
/// density.prune_scale in world units; infinity where it is 0.
float prune_scale_of(const Config& config, float scene_extent);

/// The control by the rules of a method, as most methods need it: growth_control.cpp.
std::unique_ptr<DensityControl> make_growth_control(const Config& config,
                                                    const GrowthMethod& method,
                                                    const Schedule& schedule, float scene_extent);

/// The controls of methods that do something else.
using MakeDensityControl = std::unique_ptr<DensityControl>(const Config&, const Schedule&,
                                                           float scene_extent);
MakeDensityControl make_mcmc_control;  // mcmc.cpp

}  // namespace gs
