// SPDX-License-Identifier: Apache-2.0
// Stage 9 of the MCMC strategy: dead rows become copies of live ones, and copies are added up to a
// count. A live row is drawn with a probability proportional to its opacity. It and its copies
// together look like the row before.
#include <algorithm>

#include "gs_core/threads/parallel.h"
#include "gs_train/row_rules.h"
#include "gs_train/stages/scalar_stages.h"

namespace gs {
namespace {

Span<const std::uint32_t> numbers_in(const std::vector<std::uint32_t>& rows) {
  return {rows.data(), rows.size()};
}

void clear_moments(const Columns& columns, std::size_t i) {
  for (const Column& column : columns)
    if (column.role == RowRole::moment)
      std::fill_n(column.rows->row(i), column.rows->row_bytes(), std::byte(0));
}

/// Prefix sums of the rows' weights, each row's own included.
std::vector<std::uint64_t> weight_sums(const TrainingModel& model, const RelocationRules& rules) {
  const GaussiansSpan rows = model.gaussians.span();
  std::vector<std::uint64_t> sums(model.count());
  parallel_for(sums.size(), 4096, [&](std::size_t i) {
    sums[i] = draw_weight(rows, i, rules.dead_opacity, rules.region);
  });
  for (std::size_t i = 1; i < sums.size(); ++i) sums[i] += sums[i - 1];
  return sums;
}

std::vector<std::uint32_t> dead_rows(const std::vector<std::uint64_t>& sums) {
  std::vector<std::uint32_t> dead;
  for (std::uint32_t i = 0; i < sums.size(); ++i)
    if (sums[i] == (i > 0 ? sums[i - 1] : 0)) dead.push_back(i);
  return dead;
}

/// Draws the source row of each of `count` copies.
std::vector<std::uint32_t> draw(const std::vector<std::uint64_t>& sums, std::size_t count,
                                const Random& random, int step) {
  std::vector<std::uint32_t> source(count);
  parallel_for(count, 1024, [&](std::size_t k) {
    const std::uint64_t at = random.below64(sums.back(), std::uint64_t(step), std::uint32_t(k));
    source[k] = std::uint32_t(std::upper_bound(sums.begin(), sums.end(), at) - sums.begin());
  });
  return source;
}

/// Gives each row that was drawn the opacity and scale that it shares with its copies, and zero
/// moments.
void share_sources(TrainingModel& model, Span<const std::uint32_t> source, float least_opacity) {
  std::vector<int> drawn(model.count());
  for (const std::uint32_t i : source) ++drawn[i];
  const Gaussians& rows = model.gaussians;
  const Columns columns = model.columns();
  parallel_for(drawn.size(), 4096, [&](std::size_t i) {
    if (!drawn[i]) return;
    const SharedGaussian shared =
        shared_gaussian(rows.logit_opacity[i], rows.log_scale[i], drawn[i] + 1, least_opacity);
    rows.logit_opacity[i] = shared.logit_opacity;
    rows.log_scale[i] = shared.log_scale;
    clear_moments(columns, i);
  });
}

/// Row to(k) becomes a copy of row source[k], with zero moments.
template <class To>
void copy_rows(TrainingModel& model, Span<const std::uint32_t> source, const To& to) {
  const Columns columns = model.columns();
  parallel_for(source.size, 1024, [&](std::size_t k) {
    for (const Column& column : columns)
      if (column.role == RowRole::parameter)
        std::copy_n(column.rows->row(source[k]), column.rows->row_bytes(), column.rows->row(to(k)));
    clear_moments(columns, to(k));
  });
}

std::size_t move_dead_rows(TrainingModel& model, const RelocationRules& rules, const Random& random,
                           int step) {
  const std::vector<std::uint64_t> sums = weight_sums(model, rules);
  const std::vector<std::uint32_t> dead = dead_rows(sums);
  if (dead.empty() || sums.back() == 0) return 0;
  const std::vector<std::uint32_t> source = draw(sums, dead.size(), random, step);
  replace(model, numbers_in(dead), numbers_in(source), rules.dead_opacity);
  return dead.size();
}

std::size_t add_copies(TrainingModel& model, const RelocationRules& rules, const Random& random,
                       int step) {
  const std::size_t before = model.count();
  const std::vector<std::uint64_t> sums = weight_sums(model, rules);
  if (std::int64_t(before) >= rules.grow_to || sums.empty() || sums.back() == 0) return 0;
  const std::vector<std::uint32_t> source =
      draw(sums, std::size_t(rules.grow_to) - before, random, step);
  share_sources(model, numbers_in(source), rules.dead_opacity);
  resize_rows(model, before + source.size());
  copy_rows(model, numbers_in(source), [&](std::size_t k) { return before + k; });
  return source.size();
}

}  // namespace

void replace(TrainingModel& model, Span<const std::uint32_t> dead, Span<const std::uint32_t> source,
             float least_opacity) {
  share_sources(model, source, least_opacity);
  copy_rows(model, source, [&](std::size_t k) { return dead[k]; });
}

RefineReport relocate(TrainingModel& model, const RelocationRules& rules, std::uint64_t seed,
                      int step) {
  RefineReport report;
  report.moved = move_dead_rows(model, rules, {seed, RandomStream::relocate}, step);
  report.cloned = add_copies(model, rules, {seed, RandomStream::grow}, step);
  clear_columns(model, RowRole::statistic);
  return report;
}

}  // namespace gs
