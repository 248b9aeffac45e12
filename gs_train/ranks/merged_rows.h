// SPDX-License-Identifier: Apache-2.0
// Where the rows of a dealt model are, and row operations that need all of them in one place.
#pragma once

#include <functional>
#include <utility>
#include <vector>

#include "gs_train/backend.h"

namespace gs {

/// A model whose rows are with the ranks has no statistics of its own: so the model itself says
/// where its rows are, also where another model lies at the same place.
inline bool is_dealt(const TrainingModel& model) {
  return model.statistics.visits.size() != model.count();
}

/// Row operations on the merged model, which the next step deals out again.
class MergedRows final : public RowOps {
 public:
  /// count_not_finite(rows) counts in the shards.
  MergedRows(Backend& backend, RowOps& rows, std::function<std::size_t(RowOps&)> count_not_finite)
      : backend_(backend), rows_(rows), count_not_finite_(std::move(count_not_finite)) {}
  RefineReport grow(TrainingModel& model, const GrowthRules& rules, std::uint64_t seed,
                    int step) override {
    return merged(model).grow(model, rules, seed, step);
  }
  RefineReport relocate(TrainingModel& model, const RelocationRules& rules, std::uint64_t seed,
                        int step) override {
    return merged(model).relocate(model, rules, seed, step);
  }
  void measure_filter(TrainingModel& model, const std::vector<Camera>& cameras,
                      float near_plane) override {
    merged(model).measure_filter(model, cameras, near_plane);
  }
  void lower_opacity(TrainingModel& model, const OpacityRule& rule) override {
    merged(model).lower_opacity(model, rule);
  }
  std::size_t prune(TrainingModel& model, float opacity) override {
    return merged(model).prune(model, opacity);
  }
  std::size_t prune_share(TrainingModel& model, PruneOrder order, double share) override {
    return merged(model).prune_share(model, order, share);
  }
  void sort_by_morton(TrainingModel& model) override { merged(model).sort_by_morton(model); }
  void release_caches() override { rows_.release_caches(); }
  std::size_t count_not_finite(const TrainingModel& model) override {
    return is_dealt(model) ? count_not_finite_(rows_) : rows_.count_not_finite(model);
  }

 private:
  RowOps& merged(TrainingModel& model) {
    backend_.synchronize(model);
    return rows_;
  }
  Backend& backend_;
  RowOps& rows_;
  const std::function<std::size_t(RowOps&)> count_not_finite_;
};

}  // namespace gs
