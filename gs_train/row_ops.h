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
};

/// Where memory runs out they throw Error (out of memory) before they change anything.
class RowOps {
 public:
  virtual ~RowOps() = default;

  /// Clones, splits and prunes by `rules`; clears the statistics. Survivors keep their order, clones come
  /// after them, then the halves of split rows. New rows start with zero moments.
  virtual RefineReport refine(TrainingModel& model, const AdaptiveRules& rules,
                              const Random& random, int step) = 0;
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
