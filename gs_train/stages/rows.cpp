// SPDX-License-Identifier: Apache-2.0
// Stage 9: operations on whole rows: clone, split, prune, opacity reset;
// and the gather they share.
#include <atomic>
#include <cmath>
#include <cstddef>
#include <numeric>

#include "gs_core/error.h"
#include "gs_core/radix_sort.h"
#include "gs_core/threads/parallel.h"
#include "gs_train/row_rules.h"
#include "gs_train/stages/scalar_stages.h"

namespace gs {
namespace {

enum class RowAction : std::uint8_t { keep, clone, split, prune };

// Row i of an array becomes what row source[i] was. The array and the scratch have the capacity for
// all rows, so that nothing can fail.
template <class T>
void gather_array(Buffer<T>& array, Span<const std::uint32_t> source, Buffer<std::byte>& scratch) {
  T* const gathered = reinterpret_cast<T*>(scratch.data());
  parallel_for(source.size, 4096, [&](std::size_t i) { gathered[i] = array[source[i]]; });
  array.resize_discard(source.size);
  std::copy(gathered, gathered + source.size, array.begin());
}

template <class T>
void zero_rows_from(Buffer<T>& array, std::size_t first) {
  std::fill(array.begin() + first, array.end(), T{});
}

// True where every number of the row is finite.
template <class T>
bool all_finite(const T& row) {
  const float* const numbers = reinterpret_cast<const float*>(&row);
  return std::all_of(numbers, numbers + sizeof(T) / sizeof(float),
                     [](float number) { return std::isfinite(number); });
}

// The action of each row by its statistics and the rules, including pruning.
std::vector<RowAction> actions(const TrainingModel& model, const AdaptiveRules& rules) {
  const GaussiansSpan rows = model.gaussians.span();
  std::vector<RowAction> action(model.count());
  parallel_for(model.count(), 4096, [&](std::size_t i) {
    const bool grows = rules.region.holds(rows.mean[i]) &&
                       wants_growth(model.statistics.visits[i], model.statistics.gradient_norm[i],
                                    rules.gradient_threshold);
    const bool small = is_small(rows.log_scale[i], rules.small_scale);
    const bool pruned = is_pruned(rows, i, rules);
    // A row too large to keep may still be split into halves that are not.
    action[i] = grows && !small ? RowAction::split
                : pruned        ? RowAction::prune
                : grows         ? RowAction::clone
                                : RowAction::keep;
  });
  return action;
}

// Where growth would exceed the cap, only the rows with the largest mean gradients grow.
void limit_growth(std::vector<RowAction>& action, const TrainingModel& model,
                  const AdaptiveRules& rules) {
  if (rules.max_gaussians <= 0) return;
  const DensityStatistics& statistics = model.statistics;
  std::vector<std::uint32_t> growing;
  std::int64_t staying = 0;
  for (std::uint32_t i = 0; i < action.size(); ++i) {
    if (action[i] == RowAction::clone || action[i] == RowAction::split) growing.push_back(i);
    staying += action[i] != RowAction::prune;
  }
  const std::int64_t allowed = std::max<std::int64_t>(rules.max_gaussians - staying, 0);
  if (std::int64_t(growing.size()) <= allowed) return;
  std::stable_sort(growing.begin(), growing.end(), [&](std::uint32_t a, std::uint32_t b) {
    return statistics.gradient_norm[a] * std::max(statistics.visits[b], 1.0f) >
           statistics.gradient_norm[b] * std::max(statistics.visits[a], 1.0f);
  });
  for (std::size_t k = std::size_t(allowed); k < growing.size(); ++k)
    action[growing[k]] =
        is_pruned(model.gaussians.span(), growing[k], rules) ? RowAction::prune : RowAction::keep;
}

class ScalarRowOps final : public RowOps {
 public:
  RefineReport refine(TrainingModel& model, const AdaptiveRules& rules, const Random& random,
                      int step) override {
    std::vector<RowAction> action = actions(model, rules);
    limit_growth(action, model, rules);

    std::vector<std::uint32_t> survivors, clones, parents;
    RefineReport report;
    for (std::uint32_t i = 0; i < action.size(); ++i) {
      if (action[i] == RowAction::keep || action[i] == RowAction::clone) survivors.push_back(i);
      if (action[i] == RowAction::clone) clones.push_back(i);
      if (action[i] == RowAction::split) parents.push_back(i);
      report.pruned += action[i] == RowAction::prune;
    }
    const std::vector<std::uint32_t> halves =
        kept_halves(model.gaussians.span(), rules, random, step, parents);
    report.cloned = clones.size();
    report.split = parents.size();
    report.pruned += 2 * parents.size() - halves.size();

    std::vector<std::uint32_t> source = survivors;
    source.insert(source.end(), clones.begin(), clones.end());
    for (const std::uint32_t half : halves) source.push_back(parents[half / 2]);
    gather_rows(model, {source.data(), source.size()});  // from here on nothing can fail
    start_new_rows(model, survivors.size());
    move_halves(model.gaussians.span(), survivors.size() + clones.size(), halves, random, step);
    return report;
  }

  RefineReport grow(TrainingModel& model, const GrowthRules& rules, std::uint64_t seed,
                    int step) override {
    return gs::grow(model, rules, seed, step);
  }

  RefineReport relocate(TrainingModel& model, const RelocationRules& rules, std::uint64_t seed,
                        int step) override {
    return gs::relocate(model, rules, seed, step);
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
        model,
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

  // The numbers of the halves that are not pruned at once. Halves 2 k and 2 k + 1 are those of
  // parent k.
  static std::vector<std::uint32_t> kept_halves(const GaussiansSpan& rows,
                                                const AdaptiveRules& rules, const Random& random,
                                                int step,
                                                const std::vector<std::uint32_t>& parents) {
    std::vector<std::uint8_t> is_kept(2 * parents.size());
    parallel_for(is_kept.size(), 4096, [&](std::size_t k) {
      const std::uint32_t i = parents[k / 2];
      const HalfRow half = half_of(rows, i, std::uint32_t(k), random, step);
      is_kept[k] = !is_pruned(half, rows, i, rules);
    });
    std::vector<std::uint32_t> kept;
    for (std::uint32_t k = 0; k < is_kept.size(); ++k)
      if (is_kept[k]) kept.push_back(k);
    return kept;
  }

  // Turns the rows from `first` on, which are copies of their parents, into halves.
  static void move_halves(const GaussiansSpan& rows, std::size_t first,
                          const std::vector<std::uint32_t>& halves, const Random& random,
                          int step) {
    parallel_for(halves.size(), 4096, [&](std::size_t k) {
      const std::size_t i = first + k;
      write_half(rows, i, half_of(rows, i, halves[k], random, step));
    });
  }

  template <class Predicate>
  static std::size_t prune_rows(TrainingModel& model, Predicate&& is_removed) {
    std::vector<std::uint32_t> kept;
    kept.reserve(model.count());
    for (std::uint32_t i = 0; i < model.count(); ++i)
      if (!is_removed(i)) kept.push_back(i);
    const std::size_t removed = model.count() - kept.size();
    if (removed) gather_rows(model, {kept.data(), kept.size()});
    return removed;
  }
};

}  // namespace

void start_new_rows(TrainingModel& model, std::size_t first) {
  for_each_row_array(
      [first](const RowArray& which, auto& array) {
        if (which.role == RowRole::moment) zero_rows_from(array, first);
        if (which.role == RowRole::statistic) array.fill_zero();
      },
      model);
}

void gather_rows(TrainingModel& model, Span<const std::uint32_t> source) {
  std::size_t widest = 0;  // bytes of a row
  for_each_row_array(
      [&](const RowArray&, auto& array) {
        array.reserve(source.size);
        widest = std::max(widest, sizeof(*array.data()));
      },
      model);
  Buffer<std::byte> scratch(source.size * widest, host_memory());
  for_each_row_array([&](const RowArray&, auto& array) { gather_array(array, source, scratch); },
                     model);
}

std::unique_ptr<RowOps> make_scalar_row_ops() { return std::make_unique<ScalarRowOps>(); }

}  // namespace gs
