// SPDX-License-Identifier: Apache-2.0
// Stage 9 of the methods that grow: which rows grow under a budget, what they become, and what is
// pruned.
#include <algorithm>
#include <numeric>

#include "gs_core/error.h"
#include "gs_core/threads/parallel.h"
#include "gs_core/threads/radix_sort.h"
#include "gs_train/row_rules.h"
#include "gs_train/stages/scalar_stages.h"

namespace gs {
namespace {

std::vector<GrowthAction> actions(const TrainingModel& model, const GrowthRules& rules) {
  const GaussiansSpan rows = model.gaussians.span();
  const StatisticsSpan statistics = span_of(model.statistics);
  std::vector<GrowthAction> action(model.count());
  parallel_for(action.size(), 4096,
               [&](std::size_t i) { action[i] = growth_action(rows, statistics, i, rules); });
  return action;
}

// Where more rows would grow than may, only the first ones do by their keys.
void limit_growth(std::vector<GrowthAction>& action, const TrainingModel& model,
                  const GrowthRules& rules, const Random& random, int step) {
  std::vector<std::uint32_t> growing;
  std::int64_t staying = 0;
  for (std::uint32_t i = 0; i < action.size(); ++i) {
    if (grows(action[i])) growing.push_back(i);
    if (action[i] != GrowthAction::prune) ++staying;
  }
  const std::int64_t allowed = allowed_growth(rules, staying);
  if (std::int64_t(growing.size()) <= allowed) return;
  const GaussiansSpan rows = model.gaussians.span();
  const StatisticsSpan statistics = span_of(model.statistics);
  std::vector<std::uint64_t> keys(action.size());
  parallel_for(growing.size(), 4096, [&](std::size_t k) {
    keys[growing[k]] = growth_key(statistics, growing[k], rules, random, step);
  });
  Buffer<std::uint32_t> scratch;
  radix_sort_by_key({growing.data(), growing.size()}, scratch,
                    [&](std::uint32_t i) { return keys[i]; });
  for (std::size_t k = std::size_t(allowed); k < growing.size(); ++k)
    action[growing[k]] = action_without_growth(rows, statistics, growing[k], rules);
}

// The numbers of the children that are not pruned at once. Parent k has the children 2 k and 2 k + 1,
// or k alone if it stays.
std::vector<std::uint32_t> kept_children(const GaussiansSpan& rows, const GrowthRules& rules,
                                         const Random& random, int step,
                                         const std::vector<std::uint32_t>& parents) {
  const unsigned each = rules.split.children();
  std::vector<std::uint8_t> is_kept(each * parents.size());
  parallel_for(is_kept.size(), 4096, [&](std::size_t k) {
    const std::uint32_t i = parents[k / each];
    is_kept[k] = !is_pruned(child_of(rows, i, std::uint32_t(k), rules.split, random, step), rows, i,
                            rules.limits);
  });
  std::vector<std::uint32_t> kept;
  for (std::uint32_t k = 0; k < is_kept.size(); ++k)
    if (is_kept[k]) kept.push_back(k);
  return kept;
}

}  // namespace

RefineReport grow(TrainingModel& model, const GrowthRules& rules, std::uint64_t seed, int step) {
  GS_CHECK(model.statistics.has_sums || !(needs_fragment_sums(rules.score) || rules.prunes_unseen));
  std::vector<GrowthAction> action = actions(model, rules);
  limit_growth(action, model, rules, {seed, RandomStream::growth}, step);
  const RefineReport report = apply(model, {action.data(), action.size()}, rules, seed, step);
  clear_columns(model, RowRole::statistic);
  return report;
}

RefineReport apply(TrainingModel& model, Span<const GrowthAction> action, const GrowthRules& rules,
                   std::uint64_t seed, int step) {
  const Random draws{seed, RandomStream::split_gaussians};
  std::vector<std::uint32_t> survivors, clones, parents;
  RefineReport report;
  for (std::uint32_t i = 0; i < action.size; ++i) {
    if (survives(action[i], rules)) survivors.push_back(i);
    if (action[i] == GrowthAction::clone) clones.push_back(i);
    if (action[i] == GrowthAction::split) parents.push_back(i);
    report.pruned += action[i] == GrowthAction::prune;
  }
  const std::vector<std::uint32_t> children =
      kept_children(model.gaussians.span(), rules, draws, step, parents);
  const unsigned each = rules.split.children();
  report.cloned = clones.size();
  report.split = parents.size();
  report.pruned += each * parents.size() - children.size();

  std::vector<std::uint32_t> source = survivors;
  source.insert(source.end(), clones.begin(), clones.end());
  for (const std::uint32_t child : children) source.push_back(parents[child / each]);
  const Columns columns = model.columns();
  gather_rows(columns, {source.data(), source.size()});  // from here on nothing can fail
  start_new_rows(columns, survivors.size(), survivors.size());

  const GaussiansSpan rows = model.gaussians.span();
  const std::size_t first_child = survivors.size() + clones.size();
  parallel_for(children.size(), 4096, [&](std::size_t k) {
    const std::size_t i = first_child + k;
    write_child(rows, i, child_of(rows, i, children[k], rules.split, draws, step));
  });
  if (rules.split.changes_opacity())
    parallel_for(first_child, 4096, [&](std::size_t i) {
      if (grows(action[source[i]]))
        rows.logit_opacity[i] = child_logit_opacity(rows.logit_opacity[i], rules.split);
    });
  return report;
}

}  // namespace gs
