// SPDX-License-Identifier: Apache-2.0
// Operations on whole rows of a TrainingModel: what density control and Morton order are made of.
#pragma once

#include "gs_core/math/density.h"
#include "gs_core/random.h"
#include "gs_train/optimizer.h"

namespace gs {

/// How many rows a refinement touched.
struct RefineReport {
  std::size_t cloned = 0, split = 0, pruned = 0;
  std::size_t moved = 0;  // dead ones, onto live ones
};

/// The rules of one relocation (MCMC).
struct RelocationRules {
  float dead_opacity;     // up to it a Gaussian is dead
  std::int64_t grow_to;   // rows to have in the end; fewer than there are: none is added
};

/// Where memory runs out they throw Error (out of memory) before they change anything.
class RowOps {
 public:
  virtual ~RowOps() = default;

  /// Clones, splits and prunes by `rules`; clears the statistics. Survivors keep their order, clones come
  /// after them, then the halves of split rows. New rows start with zero moments.
  virtual RefineReport refine(TrainingModel& model, const AdaptiveRules& rules,
                              const Random& random, int step) = 0;
  /// Makes each dead row a copy of a live one, then adds copies up to a count (Kheradmand et al. 2024). A row is
  /// drawn with a probability proportional to its opacity; it and its copies share what it was and start with zero
  /// moments. Rows that are degenerate or not finite are dead. Clears the statistics. Without a live row nothing is done.
  virtual RefineReport relocate(TrainingModel& model, const RelocationRules& rules,
                                std::uint64_t seed, int step) = 0;
  /// Lowers every opacity to at most `opacity` and clears the moments of the opacities.
  virtual void reset_opacity(TrainingModel& model, float opacity) = 0;
  /// Removes rows that cannot be seen: below `opacity`, degenerate, or not finite. Returns how many.
  virtual std::size_t prune(TrainingModel& model, float opacity) = 0;
  /// How many Gaussians have a parameter that is infinite or not a number.
  virtual std::size_t count_not_finite(const TrainingModel& model) = 0;
  /// Gives back memory that is held between calls.
  virtual void release_caches() {}
  /// Sorts all rows (parameters, moments, statistics) along the Morton curve of their means.
  virtual void sort_by_morton(TrainingModel& model) = 0;
};

}  // namespace gs
