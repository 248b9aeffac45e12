// SPDX-License-Identifier: Apache-2.0
// Stage 9: operations on whole rows: clone, split, prune, opacity reset; with the same
// results as the scalar twin. The host waits where it must know how many rows there will be: twice
// in a refinement, once in a pruning.
#include "cuda/density/rows.cuh"

#include <thrust/iterator/counting_iterator.h>

#include <cub/device/device_select.cuh>
#include <utility>

#include "cuda/density/filter_3d.cuh"
#include "cuda/density/grow.cuh"
#include "cuda/density/relocate.cuh"
#include "cuda/device/cub_scratch.cuh"
#include "cuda/stages.cuh"
#include "gs_core/training_memory.h"
#include "gs_train/row_rules.h"

namespace gs::cuda {
namespace {

constexpr int kThreads = 256;  // rows are independent: any size that fills a multiprocessor
constexpr std::uint64_t kGrowsNever = ~std::uint64_t(0);  // a key above those of all that grow
// The bits of an infinite double: the largest of any positive one that is a number.
constexpr std::uint64_t kInfinityBits = 0x7ff0000000000000;
constexpr int kGrowthKeyBits = 64;
constexpr int kPruneKeyBits = 32;

enum class RowAction : std::uint8_t { keep, clone, split, prune };

/// True for rows of one action or another; for CUB.
struct HasRowAction {
  const RowAction* action;
  RowAction one, other;
  __device__ bool operator()(std::uint32_t i) const {
    return action[i] == one || action[i] == other;
  }
};

/// Counts of rows, which the host reads back.
struct Counts {
  std::uint32_t survivors, clones, parents, halves;
  std::uint32_t pruned;  // before the cap
};

__device__ std::size_t thread_number() { return std::size_t(blockIdx.x) * kThreads + threadIdx.x; }

// Decides the action of each row by statistics and rules, pruning included.
__global__ void row_actions_kernel(GaussiansSpan rows, Span<const float> visits,
                                   Span<const float> gradient_norm, AdaptiveRules rules,
                                   Span<RowAction> action) {
  const std::size_t i = thread_number();
  if (i >= action.size) return;
  const bool grows = rules.region.holds(rows.mean[i]) &&
                     wants_growth(visits[i], gradient_norm[i], rules.gradient_threshold);
  const bool small = is_small(rows.log_scale[i], rules.small_scale);
  const bool pruned = is_pruned(rows, i, rules);
  // A row too large to keep may still be split into halves that are not.
  action[i] = grows && !small ? RowAction::split
              : pruned        ? RowAction::prune
              : grows         ? RowAction::clone
                              : RowAction::keep;
}

// A key that is smaller for a larger mean gradient. In double, quotients of floats that differ stay
// different. Bits of positive doubles are ordered like the doubles.
__device__ std::uint64_t growth_key(float visits, float gradient_norm) {
  const double mean = double(gradient_norm) / double(max_of(visits, 1.0f));
  return kInfinityBits - std::uint64_t(__double_as_longlong(mean));
}

// The sort keys of the rows: the largest mean gradients come first, rows that do not grow last.
// Each block counts its pruned rows.
__global__ void growth_keys_kernel(Span<const RowAction> action, Span<const float> visits,
                                   Span<const float> gradient_norm, Span<std::uint64_t> keys,
                                   Counts* counts) {
  const std::size_t i = thread_number();
  const bool exists = i < action.size;
  const int pruned = __syncthreads_count(exists && action[i] == RowAction::prune);
  if (threadIdx.x == 0) atomicAdd(&counts->pruned, unsigned(pruned));
  if (!exists) return;
  const bool grows = action[i] == RowAction::clone || action[i] == RowAction::split;
  keys[i] = grows ? growth_key(visits[i], gradient_norm[i]) : kGrowsNever;
}

// Rows that would exceed the cap do not grow: those after the first so many in `order`.
__global__ void limit_growth_kernel(GaussiansSpan rows, AdaptiveRules rules,
                                    Span<const std::uint32_t> order, const Counts* counts,
                                    Span<RowAction> action) {
  const std::size_t k = thread_number();
  if (k >= order.size) return;
  const std::int64_t staying = std::int64_t(order.size) - std::int64_t(counts->pruned);
  const std::uint32_t i = order[k];
  const bool grows = action[i] == RowAction::clone || action[i] == RowAction::split;
  if (!grows || std::int64_t(k) < rules.max_gaussians - staying) return;
  action[i] = is_pruned(rows, i, rules) ? RowAction::prune : RowAction::keep;
}

// Decides for each half whether it is kept or pruned. Halves 2k and 2k + 1 are those of parent k.
__global__ void half_row_actions_kernel(GaussiansSpan rows, Span<const std::uint32_t> parents,
                                        AdaptiveRules rules, Random random, int step,
                                        Span<RowAction> action) {
  const std::size_t k = thread_number();
  if (k >= action.size) return;
  const std::uint32_t i = parents[k / 2];
  const HalfRow half = half_of(rows, i, std::uint32_t(k), random, step);
  action[k] = is_pruned(half, rows, i, rules) ? RowAction::prune : RowAction::keep;
}

// The rows that the kept halves come from.
__global__ void half_sources_kernel(Span<const std::uint32_t> halves,
                                    Span<const std::uint32_t> parents, std::uint32_t* source) {
  const std::size_t k = thread_number();
  if (k < halves.size) source[k] = parents[halves[k] / 2];
}

// Turns the rows from `first` on, which are copies of the parents, into halves.
__global__ void move_halves_kernel(GaussiansSpan rows, std::size_t first,
                                   Span<const std::uint32_t> halves, Random random, int step) {
  const std::size_t k = thread_number();
  if (k >= halves.size) return;
  write_half(rows, first + k, half_of(rows, first + k, halves[k], random, step));
}

__global__ void visible_row_actions_kernel(GaussiansSpan rows, float min_opacity,
                                           Span<RowAction> action) {
  const std::size_t i = thread_number();
  if (i >= action.size) return;
  action[i] = is_invisible(rows, i, min_opacity) ? RowAction::prune : RowAction::keep;
}

__global__ void prune_keys_kernel(GaussiansSpan rows, StatisticsSpan statistics, PruneOrder order,
                                  Span<std::uint64_t> keys) {
  const std::size_t i = thread_number();
  if (i < keys.size) keys[i] = prune_key(order, rows.logit_opacity[i], statistics.sums_of(i));
}

// The first rows of an order are pruned.
__global__ void prune_first_kernel(Span<const std::uint32_t> order, std::size_t pruned,
                                   Span<RowAction> action) {
  const std::size_t k = thread_number();
  if (k < order.size) action[order[k]] = k < pruned ? RowAction::prune : RowAction::keep;
}

// Lowers the opacities of rows with a 3D filter, as they are after it, to at most `opacity`.
__global__ void cap_filtered_opacity_kernel(GaussiansSpan rows, float opacity) {
  const std::size_t i = thread_number();
  if (i < rows.mean.size) rows.logit_opacity[i] = capped_logit_opacity(rows, i, opacity);
}

__global__ void lower_opacity_kernel(Span<float> logit_opacity, OpacityRule rule,
                                     float logit_amount) {
  const std::size_t i = thread_number();
  if (i < logit_opacity.size)
    logit_opacity[i] = lowered_logit_opacity(logit_opacity[i], rule, logit_amount);
}

// Marks the rows that have an infinite number or NaN, of an array with `width` numbers in a row. A
// thread per number.
__global__ void mark_not_finite_kernel(Span<const float> numbers, std::size_t width,
                                       RowAction* action) {
  const std::size_t k = thread_number();
  if (k < numbers.size && numbers[k] - numbers[k] != 0.0f) action[k / width] = RowAction::prune;
}

// Each block counts its marked rows.
__global__ void count_marked_kernel(Span<const RowAction> action, Counts* counts) {
  const std::size_t i = thread_number();
  const int marked = __syncthreads_count(i < action.size && action[i] == RowAction::prune);
  if (threadIdx.x == 0) atomicAdd(&counts->pruned, unsigned(marked));
}

class CudaRowOps final : public RowOps {
 public:
  CudaRowOps(Context& context, Memory& memory, Buffer<Splat>& splats, Buffer<Rect>& pixel_rects,
             std::function<void()> release_step)
      : context_(context), release_step_(std::move(release_step)), room_(splats, pixel_rects),
        rows_(context, room_), order_workspace_(memory, room_),
        growth_(context, memory, order_workspace_), relocation_(context, memory),
        filter_(context, memory), action_(memory), source_(memory), clones_(memory),
        parents_(memory), halves_(memory), counts_(1, memory) {}

  RefineReport refine(TrainingModel& model, const AdaptiveRules& rules, const Random& random,
                      int step) override {
    StageScope scope(context_, "refine");
    const std::size_t count = model.count();
    if (count == 0) return {};
    decide(model, rules);
    const Counts found = choose_rows(count);
    const std::size_t halves = choose_halves(model.gaussians, rules, random, step, found.parents);
    const std::size_t first_half = std::size_t(found.survivors) + found.clones;
    list_sources(found, halves);
    gather_refined(model, found.survivors);
    launch(move_halves_kernel, halves, model.gaussians.span(), first_half, halves_.span(), random,
           step);
    RefineReport report;
    report.cloned = found.clones;
    report.split = found.parents;
    report.pruned = count - found.survivors + found.parents - halves;
    return report;
  }

  RefineReport grow(TrainingModel& model, const GrowthRules& rules, std::uint64_t seed,
                    int step) override {
    StageScope scope(context_, "grow");
    if (model.count() == 0) return {};
    const Growth::Result result = growth_.choose(model, rules, seed, step, source_);
    gather_refined(model, result.survivors);
    growth_.finish(model.gaussians.span(), result, rules, seed, step, source_);
    return result.report;
  }

  RefineReport relocate(TrainingModel& model, const RelocationRules& rules, std::uint64_t seed,
                        int step) override {
    StageScope scope(context_, "relocate");
    return relocation_.run(model, rules, seed, step);
  }

  void measure_filter(TrainingModel& model, const std::vector<Camera>& cameras,
                      float near_plane) override {
    StageScope scope(context_, "measure_filter");
    filter_.measure(model.gaussians, cameras, near_plane);
  }

  void lower_opacity(TrainingModel& model, const OpacityRule& rule) override {
    StageScope scope(context_, "lower_opacity");
    if (model.gaussians.has_filter && rule.policy == OpacityPolicy::reset)
      launch(cap_filtered_opacity_kernel, model.count(), model.gaussians.span(), rule.amount);
    else
      launch(lower_opacity_kernel, model.count(), model.gaussians.logit_opacity.span(), rule,
             logit(rule.amount));
    clear_moments(model, rule.clears);
  }

  std::size_t prune(TrainingModel& model, float opacity) override {
    StageScope scope(context_, "prune");
    const std::size_t count = model.count();
    if (count == 0) return 0;
    action_.resize_discard(count);
    launch(visible_row_actions_kernel, count, model.gaussians.span(), opacity, action_.span());
    return prune_marked(model);
  }

  std::size_t prune_share(TrainingModel& model, PruneOrder order, double share) override {
    StageScope scope(context_, "prune_share");
    GS_CHECK(order == PruneOrder::opacity || model.statistics.has_sums);
    const std::size_t count = model.count();
    if (count == 0) return 0;
    action_.resize_discard(count);
    launch(prune_keys_kernel, count, model.gaussians.span(), span_of(model.statistics), order,
           order_workspace_.make_keys(count));
    const Span<const std::uint32_t> rows =
        order_workspace_.sort(context_, "row operations", kPruneKeyBits);
    launch(prune_first_kernel, count, rows, share_of(count, share), action_.span());
    return prune_marked(model);
  }

  std::size_t count_not_finite(const TrainingModel& model) override {
    StageScope scope(context_, "look");
    const std::size_t count = model.count();
    if (count == 0) return 0;
    action_.resize_discard(count);
    action_.fill_zero();  // keep
    counts_.fill_zero();
    for_each_array(
        [&](const char*, const auto& array) {
          constexpr std::size_t kWidth = sizeof(*array.data()) / sizeof(float);
          const auto* const numbers = reinterpret_cast<const float*>(array.data());
          launch(mark_not_finite_kernel, count * kWidth, Span<const float>{numbers, count * kWidth},
                 kWidth, action_.data());
        },
        model.gaussians);
    launch(count_marked_kernel, count, action_.span(), counts_.data());
    return counts_.download()[0].pruned;
  }

  void release_caches() override {
    growth_.release();
    filter_.release();
    order_workspace_.release();
    action_.release();
    for (Buffer<std::uint32_t>* rows : {&source_, &clones_, &parents_, &halves_}) rows->release();
  }

  void sort_by_morton(TrainingModel& model) override {
    StageScope scope(context_, "morton");
    const Gaussians& rows = model.gaussians;
    gather_all(model, morton_order(context_, order_workspace_, rows.mean.span(),
                                   rows.time_mean.span(), rows.log_time_scale.span()));
  }

 private:
  // One thread for each of `count` rows.
  template <class... Parameters, class... Arguments>
  void launch(void (*kernel)(Parameters...), std::size_t count, Arguments&&... arguments) {
    context_.launch("row operations", kernel, blocks_for(count, kThreads), kThreads,
                    std::forward<Arguments>(arguments)...);
  }

  // The action of each row; where growth would pass the cap, only the rows with the largest mean
  // gradients grow.
  void decide(const TrainingModel& model, const AdaptiveRules& rules) {
    const std::size_t count = model.count();
    const GaussiansSpan rows = model.gaussians.span();
    const Span<float> visits = model.statistics.visits.span();
    const Span<float> gradient_norm = model.statistics.gradient_norm.span();
    action_.resize_discard(count);
    launch(row_actions_kernel, count, rows, visits, gradient_norm, rules, action_.span());
    if (rules.max_gaussians <= 0 || std::int64_t(2 * count) <= rules.max_gaussians) return;
    counts_.fill_zero();
    launch(growth_keys_kernel, count, action_.span(), visits, gradient_norm,
           order_workspace_.make_keys(count), counts_.data());
    const Span<const std::uint32_t> order =
        order_workspace_.sort(context_, "row operations", kGrowthKeyBits);
    launch(limit_growth_kernel, count, rows, rules, order, counts_.data(), action_.span());
  }

  // The numbers of the rows, or halves, whose action is one or the other, in order; and how many
  // there are.
  void select(RowAction one, RowAction other, Buffer<std::uint32_t>& chosen, std::uint32_t* found) {
    const std::size_t count = action_.size();
    chosen.resize_discard(count);
    with_cub_scratch(
        order_workspace_.cub, "row operations", [&](void* scratch, std::size_t& bytes) {
          return cub::DeviceSelect::If(scratch, bytes, thrust::counting_iterator<std::uint32_t>(0),
                                       chosen.data(), found, int(count),
                                       HasRowAction{action_.data(), one, other}, context_.stream());
        });
  }

  // Removes the rows whose action is to prune. Returns how many. Waits.
  std::size_t prune_marked(TrainingModel& model) {
    select(RowAction::keep, RowAction::keep, source_, &counts_.data()->survivors);
    source_.resize(counts_.download()[0].survivors);
    if (source_.size() < action_.size()) gather_all(model, source_.span());
    return action_.size() - source_.size();
  }

  // Lists the survivors, in source_, those of them that are cloned, and the parents of halves.
  // Waits.
  Counts choose_rows(std::size_t count) {
    Counts* const counts = counts_.data();
    select(RowAction::keep, RowAction::clone, source_, &counts->survivors);
    select(RowAction::clone, RowAction::clone, clones_, &counts->clones);
    select(RowAction::split, RowAction::split, parents_, &counts->parents);
    const Counts found = counts_.download()[0];
    GS_CHECK(std::size_t(found.survivors) + found.parents <= count);
    return found;
  }

  // Lists the halves that are not pruned. Returns how many. Waits.
  std::size_t choose_halves(const Gaussians& gaussians, const AdaptiveRules& rules,
                            const Random& random, int step, std::size_t parents) {
    halves_.resize_discard(0);
    if (parents == 0) return 0;
    action_.resize_discard(2 * parents);
    launch(half_row_actions_kernel, 2 * parents, gaussians.span(), parents_.span(), rules, random,
           step, action_.span());
    select(RowAction::keep, RowAction::keep, halves_, &counts_.data()->halves);
    halves_.resize(counts_.download()[0].halves);
    return halves_.size();
  }

  // Completes source_: after the survivors the clones, then the parents of the kept halves.
  void list_sources(const Counts& found, std::size_t halves) {
    const std::size_t first_half = std::size_t(found.survivors) + found.clones;
    source_.resize(found.survivors);
    source_.resize(first_half + halves);
    if (found.clones)
      source_.memory().copy(source_.data() + found.survivors, clones_.data(),
                            found.clones * sizeof(std::uint32_t));
    launch(half_sources_kernel, halves, halves_.span(), parents_.span(),
           source_.data() + first_half);
  }

  // Gathers by source_; the rows after the survivors are new: their moments start at zero, as all
  // statistics do.
  void gather_refined(TrainingModel& model, std::size_t survivors) {
    const Span<const std::uint32_t> source = source_.span();
    reserve_rows(model, source.size);  // from here on nothing can fail
    for_each_row_array(
        [&](const RowArray& which, auto& array) {
          switch (which.role) {
            case RowRole::parameter: return rows_.gather(array, source);
            case RowRole::moment: return rows_.gather(array, {source.data, survivors}, source.size);
            case RowRole::statistic: array.resize_discard(source.size); array.fill_zero();
          }
        },
        model);
  }

  // Reserves memory to gather so many rows of every array. A failure comes before anything is
  // changed.
  void reserve_rows(TrainingModel& model, std::size_t count) {
    bool large_ones_grow = false;
    for_each_row_array(
        [&](const RowArray&, const auto& array) {
          large_ones_grow |= array.capacity() < count &&
                             array.capacity() * sizeof(*array.data()) >= kBytesWorthReleasing;
        },
        model);
    if (large_ones_grow) release_step_();
    for_each_row_array([&](const RowArray&, auto& array) { rows_.reserve(array, count); }, model);
  }

  void gather_all(TrainingModel& model, Span<const std::uint32_t> source) {
    reserve_rows(model, source.size);
    for_each_row_array([&](const RowArray&, auto& array) { rows_.gather(array, source); }, model);
  }

  Context& context_;
  std::function<void()> release_step_;
  BorrowedRoom room_;
  RowGather rows_;
  RowOrderWorkspace order_workspace_;
  Growth growth_;
  Relocation relocation_;
  FilterMeter filter_;
  Buffer<RowAction> action_;                         // (N) of the rows, then of the halves
  Buffer<std::uint32_t> source_, clones_, parents_;  // row numbers
  Buffer<std::uint32_t> halves_;                     // numbers of those halves that are kept
  Buffer<Counts> counts_;                            // (1)
};

}  // namespace

std::unique_ptr<RowOps> make_row_ops(Context& context, Memory& memory, Buffer<Splat>& splats,
                                     Buffer<Rect>& pixel_rects,
                                     std::function<void()> release_step) {
  return std::make_unique<CudaRowOps>(context, memory, splats, pixel_rects,
                                      std::move(release_step));
}

}  // namespace gs::cuda
