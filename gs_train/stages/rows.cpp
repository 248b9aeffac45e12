// SPDX-License-Identifier: Apache-2.0
// Stage 9: operations on whole rows: refinements (grow.cpp), pruning, opacity reset; and the gather
// that they share.
#include <atomic>
#include <cmath>
#include <cstddef>
#include <numeric>

#include "gs_core/error.h"
#include "gs_core/threads/parallel.h"
#include "gs_core/threads/radix_sort.h"
#include "gs_train/row_rules.h"
#include "gs_train/stages/scalar_stages.h"

namespace gs {
namespace {

// Row i becomes what row source[i] was. The rows and the scratch have the capacity for all, so that
// nothing can fail.
void gather(ByteBuffer& rows, Span<const std::uint32_t> source, std::byte* scratch) {
  const std::size_t bytes = rows.row_bytes();
  parallel_for(source.size, 4096, [&](std::size_t i) {
    std::copy_n(rows.row(source[i]), bytes, scratch + i * bytes);
  });
  rows.resize_discard(source.size);
  std::copy_n(scratch, rows.size_bytes(), rows.bytes());
}

// True where every number of the row is finite.
template <class T>
bool all_finite(const T& row) {
  const float* const numbers = reinterpret_cast<const float*>(&row);
  return std::all_of(numbers, numbers + sizeof(T) / sizeof(float),
                     [](float number) { return std::isfinite(number); });
}

class ScalarRowOps final : public RowOps {
 public:
  RefineReport grow(TrainingModel& model, const GrowthRules& rules, std::uint64_t seed,
                    int step) override {
    return gs::grow(model, rules, seed, step);
  }

  RefineReport apply(TrainingModel& model, Span<const GrowthAction> actions,
                     const SplitRules& split, std::uint64_t seed, int step) override {
    return gs::apply(model, actions, rules_of_given(split), seed, step);
  }

  RefineReport relocate(TrainingModel& model, const RelocationRules& rules, std::uint64_t seed,
                        int step) override {
    return gs::relocate(model, rules, seed, step);
  }

  void replace(TrainingModel& model, Span<const std::uint32_t> dead,
               Span<const std::uint32_t> source, float least_opacity) override {
    gs::replace(model, dead, source, least_opacity);
  }

  void measure_filter(TrainingModel& model, const std::vector<Camera>& cameras,
                      float near_plane) override {
    gs::measure_filter(model, cameras, near_plane);
  }

  void lower_opacity(TrainingModel& model, const OpacityRule& rule) override {
    const float logit_amount = logit(rule.amount);
    if (rule.policy == OpacityPolicy::reset)
      cap_opacity(model.gaussians, rule.amount);
    else
      for (float& value : model.gaussians.logit_opacity)
        value = lowered_logit_opacity(value, rule, logit_amount);
    clear_moments(model, rule.clears);
  }

  std::size_t prune(TrainingModel& model, float opacity) override {
    return prune_rows(
        model, [&](std::size_t i) { return is_invisible(model.gaussians.span(), i, opacity); });
  }

  std::size_t prune_share(TrainingModel& model, PruneOrder order, double share) override {
    GS_CHECK(order == PruneOrder::opacity || model.statistics.has_sums);
    const GaussiansSpan rows = model.gaussians.span();
    const StatisticsSpan statistics = span_of(model.statistics);
    std::vector<std::uint32_t> lowest(model.count());
    std::iota(lowest.begin(), lowest.end(), 0u);
    Buffer<std::uint32_t> scratch;
    radix_sort_by_key({lowest.data(), lowest.size()}, scratch, [&](std::uint32_t i) {
      return prune_key(order, rows.logit_opacity[i], statistics.sums_of(i));
    });
    std::vector<std::uint8_t> is_removed(model.count());
    const std::size_t removed = share_of(model.count(), share);
    for (std::size_t k = 0; k < removed; ++k) is_removed[lowest[k]] = 1;
    return prune_rows(model, [&](std::size_t i) { return is_removed[i]; });
  }

  std::size_t count_not_finite(const TrainingModel& model) override {
    std::atomic<std::size_t> found = 0;
    parallel_chunks(model.count(), 4096, [&](std::size_t begin, std::size_t end) {
      std::size_t bad = 0;
      for (std::size_t i = begin; i < end; ++i) {
        bool is_fine = true;
        for_each_array([&](const char*, const auto& array) { is_fine &= all_finite(array[i]); },
                       model.gaussians);
        bad += !is_fine;
      }
      found += bad;
    });
    return found;
  }

  void sort_by_morton(TrainingModel& model) override {
    const Gaussians& rows = model.gaussians;
    gather_rows(
        model.columns(),
        morton_order(rows.mean.span(), rows.time_mean.span(), rows.log_time_scale.span()).span());
  }

 private:
  static void cap_opacity(const Gaussians& gaussians, float opacity) {
    const float highest = logit(opacity);
    const GaussiansSpan rows = gaussians.span();
    parallel_for(gaussians.count(), 4096, [&](std::size_t i) {
      rows.logit_opacity[i] = rows.has_filter ? capped_logit_opacity(rows, i, opacity)
                                              : std::min(rows.logit_opacity[i], highest);
    });
  }

  template <class Predicate>
  static std::size_t prune_rows(TrainingModel& model, Predicate&& is_removed) {
    std::vector<std::uint32_t> kept;
    kept.reserve(model.count());
    for (std::uint32_t i = 0; i < model.count(); ++i)
      if (!is_removed(i)) kept.push_back(i);
    const std::size_t removed = model.count() - kept.size();
    if (removed) gather_rows(model.columns(), {kept.data(), kept.size()});
    return removed;
  }
};

}  // namespace

void start_new_rows(const Columns& columns, std::size_t first, std::size_t first_statistic) {
  for (const Column& column : columns) {
    if (column.role == RowRole::moment) column.rows->zero_from(first);
    if (column.role == RowRole::statistic) column.rows->zero_from(first_statistic);
  }
}

void gather_rows(const Columns& columns, Span<const std::uint32_t> source) {
  std::size_t widest = 0;  // bytes of a row
  for (const Column& column : columns) {
    column.rows->reserve(source.size);
    widest = std::max(widest, column.rows->row_bytes());
  }
  const Buffer<std::byte> scratch(source.size * widest, host_memory());
  for (const Column& column : columns) gather(*column.rows, source, scratch.data());
}

std::unique_ptr<RowOps> make_scalar_row_ops() { return std::make_unique<ScalarRowOps>(); }

}  // namespace gs
