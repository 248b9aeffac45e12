// SPDX-License-Identifier: Apache-2.0
// What happens in which step: the standard 30,000-step schedule, scaled to the length of a run.
#pragma once

#include <vector>

#include "gs_core/camera.h"
#include "gs_core/config/config.h"
#include "gs_core/density/growth_method.h"
#include "gs_core/math/render/surface_loss.h"
#include "gs_train/update.h"

namespace gs {

/// The schedule of one run, computed from the config. Steps count from 1 to steps(). The last
/// train.extra_steps of them come after the schedule proper, at its final learning rates.
///
/// The steps in the config are those of a run of 30,000 steps. A run of S steps multiplies each by
/// S / 30,000. For example, a Morton order every 5,000 steps comes every 1,167 in a run of 7,000.
/// docs/method/schedule.md has the rule for intervals and a table of common lengths.
class Schedule {
 public:
  /// `views`: photos of an epoch; where it is 0, rules in epochs count for nothing. The method is the
  /// one of density.strategy.
  Schedule(const Config& config, float scene_extent, std::size_t views = 0)
      : Schedule(config, growth_method(config.density.strategy), scene_extent, views) {}
  Schedule(const Config& config, const GrowthMethod& method, float scene_extent,
           std::size_t views = 0);

  int steps() const { return steps_ + extra_steps_; }
  int steps_without_extra() const { return steps_; }
  LearningRates learning_rates(int step) const;
  /// Adam's rule for an update by `photos` photos.
  AdamRule adam_rule(int photos) const;
  /// Learning rate of the photometric model; 0 while opacities recover from a reset, when pictures
  /// are dark and gains would answer.
  float photometric_rate(int step) const;
  /// Learning rate of the poses; 0 where they are not refined, and at the times when those rest.
  float pose_rate(int step) const;
  /// Weight of the depth loss.
  float depth_weight(int step) const;
  SurfaceWeights surface_weights(int step) const;
  /// The factor by which the photo of this camera is reduced in the step; 1: it is not.
  int photo_reduction(int step, const Camera& camera) const;
  bool refine(int step) const;  // clone, split, prune; not where a share is pruned
  /// How much of the time between the first and the last refinement is over, 0 to 1.
  double growth_share(int step) const;
  /// True where the statistics of a refinement in this step cover every photo at least once.
  bool has_seen_all_views(int step) const;
  bool reset_opacity(int step) const;
  bool raise_sh_degree(int step) const;  // one degree more from this step on
  bool reorder(int step) const;          // Morton order
  bool gather_statistics(int step) const;
  /// Measure the 3D filter again: at every refinement and as often before the first one, and then
  /// at every tenth of such intervals, since the means hardly move any more.
  bool measure_filter(int step) const;
  bool prune_large(int step) const;  // refinements after the first reset also drop huge Gaussians
  bool prune_late(int step) const;   // GrowthMethod::late_prune_opacity

  /// Share of the Gaussians, the faintest, that goes some steps after an opacity reset.
  double recovery_prune(int step) const;
  /// Share of the Gaussians, those to which the loss is least sensitive, that goes in this step. No
  /// refinement comes between it and the epoch in which the sensitivities are measured.
  double sensitivity_prune(int step) const;
  bool measure_sensitivity(int step) const;

 private:
  struct Steps {
    int after, until;  // the steps after + 1 to until
    bool has(int step) const { return step > after && step <= until; }
  };

  double cooldown(int step) const;  // what is left of the learning rates, 1 to 0
  int scaled(int step) const;
  int scaled_or_none(int step) const { return step > 0 ? scaled(step) : 0; }
  void plan_refinements();
  void plan_pruning();
  bool is_refinement_due(int step) const;
  int next_refinement(int step) const;
  int last_clearing_before(int step) const;
  Steps last_epoch(int step) const;
  Steps steps_of_statistics(int refinement) const;
  int next_share_prune(int step) const;
  bool recovers_from_reset(int step) const;
  int steps_, extra_steps_, refine_from_, refine_until_, refine_every_;
  int reset_every_, reset_until_, extra_reset_, sh_every_, morton_every_, morton_until_;
  int recovery_until_, share_prune_from_, share_prune_every_, share_prune_until_;
  int views_;
  DensityConfig density_;
  GrowthMethod method_;
  int decay_from_, cooldown_from_;
  std::vector<int> ramp_;
  int ramp_every_;
  std::size_t ramp_least_;  // pixels
  OptimizerConfig rates_;
  bool batch_rates_;
  float photometric_rate_;
  int photometric_warmup_;
  float pose_rate_;
  double depth_weight_;
  int pose_warmup_;
  SurfaceWeights surface_weights_;
  int surface_from_, batch_;
  float extent_;
};

}  // namespace gs
