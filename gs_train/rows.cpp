// SPDX-License-Identifier: Apache-2.0
// Stage 9: operations on whole rows: clone, split, prune, opacity reset; and the gather they share.
#include <numeric>

#include "gs_core/error.h"
#include "gs_core/parallel.h"
#include "gs_train/scalar_stages.h"

namespace gs {
namespace {

enum class Fate : std::uint8_t { keep, clone, split, prune };

template <class T>
void gather_array(Buffer<T>& array, Span<const std::uint32_t> source) {
  Buffer<T> gathered(source.size, array.memory());
  parallel_for(source.size, 4096, [&](std::size_t i) { gathered[i] = array[source[i]]; });
  array = std::move(gathered);
}

template <class T>
void zero_rows_from(Buffer<T>& array, std::size_t first) {
  std::fill(array.begin() + first, array.end(), T{});
}

bool row_is_pruned(const GaussiansSpan& rows, std::size_t i, const AdaptiveRules& rules) {
  return is_pruned(rows.mean[i], rows.log_scale[i], rows.rotation[i], rows.logit_opacity[i], rules);
}

// What the statistics and the rules ask of each row, pruning included.
std::vector<Fate> fates(const TrainingModel& model, const AdaptiveRules& rules) {
  const GaussiansSpan rows = model.gaussians.span();
  std::vector<Fate> fate(model.count());
  parallel_for(model.count(), 4096, [&](std::size_t i) {
    const bool grows = wants_growth(model.statistics.visits[i], model.statistics.gradient_norm[i],
                                    rules.gradient_threshold);
    const bool small = is_small(rows.log_scale[i], rules.small_scale);
    const bool pruned = row_is_pruned(rows, i, rules);
    // A row too large to keep may still be split into halves that are not.
    fate[i] = grows && !small ? Fate::split
              : pruned        ? Fate::prune
              : grows         ? Fate::clone
                              : Fate::keep;
  });
  return fate;
}

// Where growth would pass the cap, only the rows with the largest mean gradients grow.
void limit_growth(std::vector<Fate>& fate, const TrainingModel& model, const AdaptiveRules& rules) {
  if (rules.max_gaussians <= 0) return;
  const DensityStatistics& statistics = model.statistics;
  std::vector<std::uint32_t> growing;
  std::int64_t staying = 0;
  for (std::uint32_t i = 0; i < fate.size(); ++i) {
    if (fate[i] == Fate::clone || fate[i] == Fate::split) growing.push_back(i);
    staying += fate[i] != Fate::prune;
  }
  const std::int64_t room = std::max<std::int64_t>(rules.max_gaussians - staying, 0);
  if (std::int64_t(growing.size()) <= room) return;
  std::stable_sort(growing.begin(), growing.end(), [&](std::uint32_t a, std::uint32_t b) {
    return statistics.gradient_norm[a] * std::max(statistics.visits[b], 1.0f) >
           statistics.gradient_norm[b] * std::max(statistics.visits[a], 1.0f);
  });
  for (std::size_t k = std::size_t(room); k < growing.size(); ++k)
    fate[growing[k]] =
        row_is_pruned(model.gaussians.span(), growing[k], rules) ? Fate::prune : Fate::keep;
}

class ScalarRowOps final : public RowOps {
 public:
  RefineReport refine(TrainingModel& model, const AdaptiveRules& rules, const Random& random,
                      int step) override {
    std::vector<Fate> fate = fates(model, rules);
    limit_growth(fate, model, rules);

    std::vector<std::uint32_t> survivors, clones, halves;
    RefineReport report;
    for (std::uint32_t i = 0; i < fate.size(); ++i) {
      if (fate[i] == Fate::keep || fate[i] == Fate::clone) survivors.push_back(i);
      if (fate[i] == Fate::clone) clones.push_back(i);
      if (fate[i] == Fate::split) halves.insert(halves.end(), {i, i});
      report.pruned += fate[i] == Fate::prune;
    }
    report.cloned = clones.size();
    report.split = halves.size() / 2;

    std::vector<std::uint32_t> source = survivors;
    source.insert(source.end(), clones.begin(), clones.end());
    source.insert(source.end(), halves.begin(), halves.end());
    gather_rows(model, {source.data(), source.size()});
    start_afresh(model, survivors.size());
    move_halves(model.gaussians, survivors.size() + clones.size(), halves, random, step);
    report.pruned += prune_rows(model, [&](std::size_t i) {
      return i >= survivors.size() + clones.size() &&
             row_is_pruned(model.gaussians.span(), i, rules);
    });
    model.statistics.visits.fill_zero();
    model.statistics.gradient_norm.fill_zero();
    return report;
  }

  RefineReport relocate(TrainingModel& model, const RelocationRules& rules, std::uint64_t seed,
                        int step) override {
    return gs::relocate(model, rules, seed, step);
  }

  void reset_opacity(TrainingModel& model, float opacity) override {
    const float highest = logit(opacity);
    for (float& value : model.gaussians.logit_opacity) value = std::min(value, highest);
    model.first_moment.logit_opacity.fill_zero();
    model.second_moment.logit_opacity.fill_zero();
  }

  std::size_t prune(TrainingModel& model, float opacity) override {
    return prune_rows(model, [&](std::size_t i) {
      const Gaussians& rows = model.gaussians;
      return is_invisible(rows.mean[i], rows.log_scale[i], rows.rotation[i], rows.logit_opacity[i],
                          opacity);
    });
  }

  void sort_by_morton(TrainingModel& model) override {
    gather_rows(model, morton_order(model.gaussians.mean.span()).span());
  }

 private:
  // Rows from `first` on are new: their moments start at zero.
  static void start_afresh(TrainingModel& model, std::size_t first) {
    for_each_array(
        [&](const char*, auto& m, auto& v) {
          zero_rows_from(m, first);
          zero_rows_from(v, first);
        },
        model.first_moment, model.second_moment);
  }

  // Puts each half of a split at its own draw from the parent and shrinks it.
  static void move_halves(Gaussians& rows, std::size_t first,
                          const std::vector<std::uint32_t>& parents, const Random& random,
                          int step) {
    parallel_for(parents.size(), 4096, [&](std::size_t k) {
      const std::size_t i = first + k;
      const Vec4f normal = random.normal4(std::uint64_t(step), std::uint32_t(k));
      rows.mean[i] = split_mean(rows.mean[i], rows.log_scale[i], rows.rotation[i],
                                {normal.x, normal.y, normal.z});
      rows.log_scale[i] = split_log_scale(rows.log_scale[i]);
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

void gather_rows(TrainingModel& model, Span<const std::uint32_t> source) {
  const auto gather = [&](const char*, auto& array) { gather_array(array, source); };
  for_each_array(gather, model.gaussians);
  for_each_array(gather, model.first_moment);
  for_each_array(gather, model.second_moment);
  gather_array(model.statistics.visits, source);
  gather_array(model.statistics.gradient_norm, source);
}

std::unique_ptr<RowOps> make_scalar_row_ops() { return std::make_unique<ScalarRowOps>(); }

}  // namespace gs
