// SPDX-License-Identifier: Apache-2.0
// Operations on whole rows of a TrainingModel. Density control and the Morton order consist of
// them.
#pragma once

#include <vector>

#include "gs_core/camera.h"
#include "gs_core/math/density/density.h"
#include "gs_core/math/density/growth.h"
#include "gs_core/math/random.h"
#include "gs_train/update.h"

namespace gs {

/// How many rows a refinement touched.
struct RefineReport {
  std::size_t cloned = 0, split = 0, pruned = 0;
  std::size_t moved = 0;  // dead rows that became copies of live ones
};

/// The rules of one relocation (MCMC).
struct RelocationRules {
  float dead_opacity;    // a Gaussian of at most this opacity is dead
  std::int64_t grow_to;  // number of rows in the end; no row is added where there are more already
  Region region = {};    // rows outside of it are hardly ever copied
};

/// Where memory runs out, every operation throws Error (out of memory) before it changes anything.
class RowOps {
 public:
  virtual ~RowOps() = default;

  /// A refinement (growth.h): clones, splits and prunes by `rules`, and clears the statistics.
  /// Survivors keep their order; clones come after them, then the children of split rows. A parent
  /// that is kept beside its child is a survivor. New rows start with zero moments. Of `seed` come
  /// the draws of children and of the rows that grow. The model has the statistics that the score
  /// needs.
  virtual RefineReport grow(TrainingModel& model, const GrowthRules& rules, std::uint64_t seed,
                            int step) = 0;
  /// The same by actions that are given, one for each row, in host memory. Survivors keep their
  /// statistics; those of new rows are zero. A child stays unless it is degenerate or not finite.
  virtual RefineReport apply(TrainingModel& model, Span<const GrowthAction> actions,
                             const SplitRules& split, std::uint64_t seed, int step) = 0;
  /// Makes each dead row a copy of a live one, then adds copies up to a count (Kheradmand et al.
  /// 2024). A row is drawn with a probability proportional to its opacity. It and its copies
  /// together look like the row before, and start with zero moments. Rows that are degenerate or
  /// not finite are dead. Clears the statistics. Without a live row it does nothing.
  virtual RefineReport relocate(TrainingModel& model, const RelocationRules& rules,
                                std::uint64_t seed, int step) = 0;
  /// The same by rows that are given, in host memory: row dead[k] becomes a copy of row source[k],
  /// whose opacity and scale they share, the opacity above `least_opacity`. No row is dead twice, or
  /// dead and a source.
  virtual void replace(TrainingModel& model, Span<const std::uint32_t> dead,
                       Span<const std::uint32_t> source, float least_opacity) = 0;
  /// Gives each row the 3D filter (math/filter_3d.h) of the camera that samples it most densely, and
  /// rows that no camera sees the largest filter of the others, or 0 if there are none. The rows
  /// have filters from then on.
  ///
  /// cameras     those of the training views
  /// near_plane  world units
  virtual void measure_filter(TrainingModel& model, const std::vector<Camera>& cameras,
                              float near_plane) = 0;
  /// Lowers every opacity by a rule, and clears the moments that the rule names. Where rows have a
  /// filter, OpacityPolicy::reset is of the opacity after it.
  virtual void lower_opacity(TrainingModel& model, const OpacityRule& rule) = 0;
  /// Lowers every opacity to at most `opacity` and clears the moments of the opacities.
  void reset_opacity(TrainingModel& model, float opacity) {
    lower_opacity(model, {OpacityPolicy::reset, opacity, MomentClearing::opacity});
  }
  /// Removes rows that cannot be seen: below `opacity`, degenerate, or not finite. Returns how
  /// many.
  virtual std::size_t prune(TrainingModel& model, float opacity) = 0;
  /// Removes this share of the rows, rounded down: the lowest ones by an order, of equal ones those
  /// with the lowest numbers. By sensitivity the model has sums over fragments. Returns how many.
  virtual std::size_t prune_share(TrainingModel& model, PruneOrder order, double share) = 0;
  /// The number of Gaussians with a parameter that is infinite or not a number.
  virtual std::size_t count_not_finite(const TrainingModel& model) = 0;
  /// Releases buffers that are kept between calls.
  virtual void release_caches() {}
  /// Sorts all rows (parameters, moments, statistics) along the Morton curve of their means.
  virtual void sort_by_morton(TrainingModel& model) = 0;
};

}  // namespace gs
