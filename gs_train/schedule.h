// SPDX-License-Identifier: Apache-2.0
// What happens in which step: the standard 30,000-step schedule, scaled to the length of a run.
#pragma once

#include "gs_core/config/config.h"
#include "gs_train/optimizer.h"

namespace gs {

/// The schedule of one run, computed from the config. Steps count from 1 to steps(). The last
/// train.extra_steps of them come after the schedule proper, at its final learning rates.
///
/// The steps in the config are those of a run of 30,000 steps. A run of S steps multiplies each by
/// S / 30,000. For example, a Morton order every 5,000 steps comes every 1,167 in a run of 7,000.
/// docs/schedule.md has the rule for intervals and a table of common lengths.
class Schedule {
 public:
  /// `views`: photos of an epoch; where it is 0, density.every_epochs counts for nothing.
  Schedule(const Config& config, float scene_extent, std::size_t views = 0);

  int steps() const { return steps_ + extra_steps_; }
  int steps_without_extra() const { return steps_; }
  LearningRates learning_rates(int step) const;
  bool refine(int step) const;  // clone, split, prune
  /// How much of the time between the first and the last refinement is over, 0 to 1.
  double growth_share(int step) const;
  /// True where the statistics of a refinement in this step cover every photo at least once.
  bool has_seen_all_views(int step) const;
  bool reset_opacity(int step) const;
  bool raise_sh_degree(int step) const;  // one degree more from this step on
  bool reorder(int step) const;          // Morton order
  bool gather_statistics(int step) const;
  bool prune_large(int step) const;  // refinements after the first reset also drop huge Gaussians

 private:
  int scaled(int step) const;
  int steps_, extra_steps_, refine_from_, refine_until_, refine_every_;
  int reset_every_, reset_until_, extra_reset_, sh_every_, morton_every_, morton_until_;
  int views_;
  OptimizerConfig rates_;
  float extent_;
};

}  // namespace gs
