// SPDX-License-Identifier: Apache-2.0
// Stage 9 of the methods that grow, with the same rows as the scalar twin: scores are computed in
// double and draws with integers (growth.h, race.h). A limit on the growth sorts all rows by key.
#include "cuda/density/grow.cuh"

#include <thrust/iterator/counting_iterator.h>

#include <cub/device/device_select.cuh>

#include "cuda/device/cub_scratch.cuh"
#include "cuda/stages.cuh"

namespace gs::cuda {
namespace {

constexpr int kKeyBits = 64;

__global__ void actions_kernel(GaussiansSpan rows, StatisticsSpan statistics, GrowthRules rules,
                               Span<GrowthAction> action) {
  const std::size_t i = row_of_thread();
  if (i < action.size) action[i] = growth_action(rows, statistics, i, rules);
}

// The sort keys of the rows; those that do not grow come last. Each block counts its pruned rows.
__global__ void keys_kernel(StatisticsSpan statistics, GrowthRules rules, Random random, int step,
                            Span<const GrowthAction> action, Span<std::uint64_t> keys,
                            GrowthCounts* counts) {
  const std::size_t i = row_of_thread();
  const bool exists = i < action.size;
  const int pruned = __syncthreads_count(exists && action[i] == GrowthAction::prune);
  if (threadIdx.x == 0) atomicAdd(&counts->pruned, unsigned(pruned));
  if (!exists) return;
  keys[i] = grows(action[i]) ? growth_key(statistics, i, rules, random, step) : kNeverDrawn;
}

// Rows do not grow that come after the first so many in `order`.
__global__ void limit_kernel(GaussiansSpan rows, StatisticsSpan statistics, GrowthRules rules,
                             Span<const std::uint32_t> order, const GrowthCounts* counts,
                             Span<GrowthAction> action) {
  const std::size_t k = row_of_thread();
  if (k >= order.size) return;
  const std::int64_t staying = std::int64_t(order.size) - std::int64_t(counts->pruned);
  const std::uint32_t i = order[k];
  if (!grows(action[i]) || std::int64_t(k) < allowed_growth(rules, staying)) return;
  action[i] = action_without_growth(rows, statistics, i, rules);
}

__global__ void child_actions_kernel(GaussiansSpan rows, Span<const std::uint32_t> parents,
                                     GrowthRules rules, Random random, int step,
                                     Span<GrowthAction> action) {
  const std::size_t k = row_of_thread();
  if (k >= action.size) return;
  const std::uint32_t i = parents[k / rules.split.children()];
  const ChildRow child = child_of(rows, i, std::uint32_t(k), rules.split, random, step);
  action[k] = is_pruned(child, rows, i, rules.limits) ? GrowthAction::prune : GrowthAction::keep;
}

__global__ void child_sources_kernel(Span<const std::uint32_t> children,
                                     Span<const std::uint32_t> parents, unsigned each,
                                     std::uint32_t* source) {
  const std::size_t k = row_of_thread();
  if (k < children.size) source[k] = parents[children[k] / each];
}

__global__ void write_children_kernel(GaussiansSpan rows, std::size_t first,
                                      Span<const std::uint32_t> children, SplitRules rules,
                                      Random random, int step) {
  const std::size_t k = row_of_thread();
  if (k >= children.size) return;
  const std::size_t i = first + k;
  write_child(rows, i, child_of(rows, i, children[k], rules, random, step));
}

// Originals beside a copy or a child, and copies: all rows before the first child that come from
// one that grew.
__global__ void share_opacity_kernel(Span<float> logit_opacity, const std::uint32_t* source,
                                     const GrowthAction* action, SplitRules rules) {
  const std::size_t i = row_of_thread();
  if (i < logit_opacity.size && grows(action[source[i]]))
    logit_opacity[i] = child_logit_opacity(logit_opacity[i], rules);
}

/// Predicates of rows, for CUB.
struct Survives {
  const GrowthAction* action;
  GrowthRules rules;
  __device__ bool operator()(std::uint32_t i) const { return survives(action[i], rules); }
};
struct HasGrowthAction {
  const GrowthAction* action;
  GrowthAction wanted;
  __device__ bool operator()(std::uint32_t i) const { return action[i] == wanted; }
};

}  // namespace

template <class... Parameters, class... Arguments>
void Growth::launch(void (*kernel)(Parameters...), std::size_t count, Arguments&&... arguments) {
  launch_rows(context_, "growth", kernel, count, std::forward<Arguments>(arguments)...);
}

// The numbers of the rows for which the predicate holds, in order; and how many there are.
template <class Predicate>
void Growth::select(std::size_t count, const Predicate& predicate, Buffer<std::uint32_t>& chosen,
                    std::uint32_t* found) {
  chosen.resize_discard(count);
  with_cub_scratch(workspace_.cub, "growth", [&](void* scratch, std::size_t& bytes) {
    return cub::DeviceSelect::If(scratch, bytes, thrust::counting_iterator<std::uint32_t>(0),
                                 chosen.data(), found, int(count), predicate, context_.stream());
  });
}

void Growth::decide(const TrainingModel& model, const GrowthRules& rules, std::uint64_t seed,
                    int step) {
  GS_CHECK(model.statistics.has_sums || !(needs_fragment_sums(rules.score) || rules.prunes_unseen));
  const Random random{seed, RandomStream::growth};
  const std::size_t count = model.count();
  const GaussiansSpan rows = model.gaussians.span();
  const StatisticsSpan statistics = span_of(model.statistics);
  action_.resize_discard(count);
  launch(actions_kernel, count, rows, statistics, rules, action_.span());
  counts_.fill_zero();
  launch(keys_kernel, count, statistics, rules, random, step, action_.span(),
         workspace_.make_keys(count), counts_.data());
  const Span<const std::uint32_t> order = workspace_.sort(context_, "growth", kKeyBits);
  launch(limit_kernel, count, rows, statistics, rules, order, counts_.data(), action_.span());
}

void Growth::take(Span<const GrowthAction> actions) {
  action_.resize_discard(actions.size);
  action_.memory().upload(action_.data(), actions.data, actions.size * sizeof *actions.data);
  counts_.fill_zero();
}

void Growth::choose_children(const TrainingModel& model, const GrowthRules& rules,
                             const Random& random, int step, std::size_t parents) {
  children_.resize_discard(0);
  if (parents == 0) return;
  const std::size_t count = rules.split.children() * parents;
  child_action_.resize_discard(count);
  launch(child_actions_kernel, count, model.gaussians.span(), parents_.span(), rules, random, step,
         child_action_.span());
  select(count, HasGrowthAction{child_action_.data(), GrowthAction::keep}, children_,
         &counts_.data()->children);
  children_.resize(counts_.download()[0].children);
}

Growth::Result Growth::choose(const TrainingModel& model, const GrowthRules& rules,
                              std::uint64_t seed, int step, Buffer<std::uint32_t>& source) {
  const std::size_t count = model.count();
  GrowthCounts* const counts = counts_.data();
  select(count, Survives{action_.data(), rules}, source, &counts->survivors);
  select(count, HasGrowthAction{action_.data(), GrowthAction::clone}, clones_, &counts->clones);
  select(count, HasGrowthAction{action_.data(), GrowthAction::split}, parents_, &counts->parents);
  const GrowthCounts found = counts_.download()[0];
  parents_.resize(found.parents);
  choose_children(model, rules, {seed, RandomStream::split_gaussians}, step, found.parents);

  Result result;
  const unsigned each = rules.split.children();
  const std::size_t kept_parents = rules.split.keeps_parent ? found.parents : 0;
  result.survivors = found.survivors;
  result.first_child = std::size_t(found.survivors) + found.clones;
  result.report.cloned = found.clones;
  result.report.split = found.parents;
  const std::size_t pruned_rows = count - found.survivors - (found.parents - kept_parents);
  result.report.pruned = pruned_rows + each * found.parents - children_.size();

  source.resize(found.survivors);
  source.resize(result.first_child + children_.size());
  if (found.clones)
    source.memory().copy(source.data() + found.survivors, clones_.data(),
                         found.clones * sizeof(std::uint32_t));
  launch(child_sources_kernel, children_.size(), children_.span(), parents_.span(), each,
         source.data() + result.first_child);
  return result;
}

void Growth::finish(const GaussiansSpan& rows, const Result& result, const GrowthRules& rules,
                    std::uint64_t seed, int step, const Buffer<std::uint32_t>& source) {
  const Random random{seed, RandomStream::split_gaussians};
  launch(write_children_kernel, children_.size(), rows, result.first_child, children_.span(),
         rules.split, random, step);
  if (rules.split.changes_opacity())
    launch(share_opacity_kernel, result.first_child,
           Span<float>{rows.logit_opacity.data, result.first_child}, source.data(), action_.data(),
           rules.split);
}

void Growth::release() {
  action_.release();
  child_action_.release();
  for (Buffer<std::uint32_t>* rows : {&clones_, &parents_, &children_}) rows->release();
}

}  // namespace gs::cuda
