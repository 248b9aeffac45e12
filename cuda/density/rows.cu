// SPDX-License-Identifier: Apache-2.0
// Stage 9: operations on whole rows: refinements (grow.cu), pruning, opacity reset; with the same
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
#include "gs_core/forecast/training_memory.h"
#include "gs_train/row_rules.h"

namespace gs::cuda {
namespace {

constexpr int kPruneKeyBits = 32;

/// A row's mark: 1 where it goes, 0 where it stays.
using Mark = std::uint8_t;

/// True for rows without a mark; for CUB.
struct IsUnmarked {
  const Mark* marks;
  __device__ bool operator()(std::uint32_t i) const { return marks[i] == 0; }
};

__global__ void mark_invisible_kernel(GaussiansSpan rows, float min_opacity, Span<Mark> marks) {
  const std::size_t i = row_of_thread();
  if (i < marks.size) marks[i] = is_invisible(rows, i, min_opacity);
}

__global__ void prune_keys_kernel(GaussiansSpan rows, StatisticsSpan statistics, PruneOrder order,
                                  Span<std::uint64_t> keys) {
  const std::size_t i = row_of_thread();
  if (i < keys.size) keys[i] = prune_key(order, rows.logit_opacity[i], statistics.sums_of(i));
}

// Marks the first rows of an order.
__global__ void mark_first_kernel(Span<const std::uint32_t> order, std::size_t marked,
                                  Span<Mark> marks) {
  const std::size_t k = row_of_thread();
  if (k < order.size) marks[order[k]] = k < marked;
}

// Lowers the opacities of rows with a 3D filter, as they are after it, to at most `opacity`.
__global__ void cap_filtered_opacity_kernel(GaussiansSpan rows, float opacity) {
  const std::size_t i = row_of_thread();
  if (i < rows.mean.size) rows.logit_opacity[i] = capped_logit_opacity(rows, i, opacity);
}

__global__ void lower_opacity_kernel(Span<float> logit_opacity, OpacityRule rule,
                                     float logit_amount) {
  const std::size_t i = row_of_thread();
  if (i < logit_opacity.size)
    logit_opacity[i] = lowered_logit_opacity(logit_opacity[i], rule, logit_amount);
}

// Marks the rows that have an infinite number or NaN, of an array with `width` numbers in a row. A
// thread per number.
__global__ void mark_not_finite_kernel(Span<const float> numbers, std::size_t width, Mark* marks) {
  const std::size_t k = row_of_thread();
  if (k < numbers.size && numbers[k] - numbers[k] != 0.0f) marks[k / width] = 1;
}

// Each block counts its marked rows.
__global__ void count_marked_kernel(Span<const Mark> marks, std::uint32_t* count) {
  const std::size_t i = row_of_thread();
  const int marked = __syncthreads_count(i < marks.size && marks[i]);
  if (threadIdx.x == 0) atomicAdd(count, unsigned(marked));
}

class CudaRowOps final : public RowOps {
 public:
  CudaRowOps(Context& context, Memory& memory, Buffer<Splat>& splats, Buffer<Rect>& pixel_rects,
             std::function<void()> release_step)
      : context_(context), release_step_(std::move(release_step)), borrowed_(splats, pixel_rects),
        order_workspace_(memory, borrowed_), growth_(context, memory, order_workspace_),
        relocation_(context, memory), filter_(context, memory), marks_(memory), source_(memory),
        count_(1, memory) {}

  RefineReport grow(TrainingModel& model, const GrowthRules& rules, std::uint64_t seed,
                    int step) override {
    StageScope scope(context_, "grow");
    if (model.count() == 0) return {};
    growth_.decide(model, rules, seed, step);
    return refine(model, rules, seed, step, false);
  }

  RefineReport apply(TrainingModel& model, Span<const GrowthAction> actions,
                     const SplitRules& split, std::uint64_t seed, int step) override {
    StageScope scope(context_, "apply");
    if (model.count() == 0) return {};
    growth_.take(actions);
    return refine(model, rules_of_given(split), seed, step, true);
  }

  RefineReport relocate(TrainingModel& model, const RelocationRules& rules, std::uint64_t seed,
                        int step) override {
    StageScope scope(context_, "relocate");
    return relocation_.run(model, rules, seed, step);
  }

  void replace(TrainingModel& model, Span<const std::uint32_t> dead,
               Span<const std::uint32_t> source, float least_opacity) override {
    StageScope scope(context_, "replace");
    relocation_.replace(model, dead, source, least_opacity);
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
    marks_.resize_discard(count);
    launch(mark_invisible_kernel, count, model.gaussians.span(), opacity, marks_.span());
    return prune_marked(model);
  }

  std::size_t prune_share(TrainingModel& model, PruneOrder order, double share) override {
    StageScope scope(context_, "prune_share");
    GS_CHECK(order == PruneOrder::opacity || model.statistics.has_sums);
    const std::size_t count = model.count();
    if (count == 0) return 0;
    marks_.resize_discard(count);
    launch(prune_keys_kernel, count, model.gaussians.span(), span_of(model.statistics), order,
           order_workspace_.make_keys(count));
    const Span<const std::uint32_t> rows =
        order_workspace_.sort(context_, "row operations", kPruneKeyBits);
    launch(mark_first_kernel, count, rows, share_of(count, share), marks_.span());
    return prune_marked(model);
  }

  std::size_t count_not_finite(const TrainingModel& model) override {
    StageScope scope(context_, "look");
    const std::size_t count = model.count();
    if (count == 0) return 0;
    marks_.resize_discard(count);
    marks_.fill_zero();
    count_.fill_zero();
    for_each_array(
        [&](const char*, const auto& array) {
          const Span<const float> numbers = numbers_of(array);
          launch(mark_not_finite_kernel, numbers.size, numbers, numbers.size / count,
                 marks_.data());
        },
        model.gaussians);
    launch(count_marked_kernel, count, marks_.span(), count_.data());
    return count_.download()[0];
  }

  void release_caches() override {
    growth_.release();
    filter_.release();
    order_workspace_.release();
    marks_.release();
    source_.release();
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
    launch_rows(context_, "row operations", kernel, count, std::forward<Arguments>(arguments)...);
  }

  // Removes the rows with a mark. Returns how many. Waits.
  std::size_t prune_marked(TrainingModel& model) {
    const std::size_t count = marks_.size();
    source_.resize_discard(count);
    with_cub_scratch(
        order_workspace_.cub, "row operations", [&](void* scratch, std::size_t& bytes) {
          return cub::DeviceSelect::If(scratch, bytes, thrust::counting_iterator<std::uint32_t>(0),
                                       source_.data(), count_.data(), int(count),
                                       IsUnmarked{marks_.data()}, context_.stream());
        });
    source_.resize(count_.download()[0]);
    if (source_.size() < count) gather_all(model, source_.span());
    return count - source_.size();
  }

  // What growth_ has decided or taken.
  RefineReport refine(TrainingModel& model, const GrowthRules& rules, std::uint64_t seed, int step,
                      bool keeps_statistics) {
    const Growth::Result result = growth_.choose(model, rules, seed, step, source_);
    gather_refined(model, result.survivors, keeps_statistics);
    growth_.finish(model.gaussians.span(), result, rules, seed, step, source_);
    return result.report;
  }

  // Gathers by source_; the rows after the survivors are new: their moments start at zero, and so do
  // their statistics, or those of all rows.
  void gather_refined(TrainingModel& model, std::size_t survivors, bool keeps_statistics) {
    const Span<const std::uint32_t> source = source_.span();
    reserve_rows(model, source.size);  // from here on nothing can fail
    for (const Column& column : model.columns()) {
      const std::size_t gathered = column.role == RowRole::parameter ? source.size
                                   : column.role == RowRole::moment || keeps_statistics ? survivors
                                                                                        : 0;
      gather(context_, borrowed_, *column.rows, {source.data, gathered}, source.size);
    }
  }

  // Reserves memory to gather so many rows of every array. A failure comes before anything is
  // changed.
  void reserve_rows(TrainingModel& model, std::size_t count) {
    const Columns columns = model.columns();
    const bool large_ones_grow =
        std::any_of(columns.begin(), columns.end(), [count](const Column& column) {
          const std::size_t capacity = column.rows->capacity();
          return capacity < count && capacity * column.rows->row_bytes() >= kBytesWorthReleasing;
        });
    if (large_ones_grow) release_step_();
    for (const Column& column : columns) column.rows->reserve(count);
    borrowed_.reserve(count);
  }

  void gather_all(TrainingModel& model, Span<const std::uint32_t> source) {
    reserve_rows(model, source.size);
    for (const Column& column : model.columns())
      gather(context_, borrowed_, *column.rows, source, source.size);
  }

  Context& context_;
  std::function<void()> release_step_;
  BorrowedMemory borrowed_;
  RowOrderWorkspace order_workspace_;
  Growth growth_;
  Relocation relocation_;
  FilterMeter filter_;
  Buffer<Mark> marks_;            // (N)
  Buffer<std::uint32_t> source_;  // the row that each row of the new model comes from
  Buffer<std::uint32_t> count_;   // (1)  of rows, which the host reads back
};

}  // namespace

std::unique_ptr<RowOps> make_row_ops(Context& context, Memory& memory, Buffer<Splat>& splats,
                                     Buffer<Rect>& pixel_rects,
                                     std::function<void()> release_step) {
  return std::make_unique<CudaRowOps>(context, memory, splats, pixel_rects,
                                      std::move(release_step));
}

}  // namespace gs::cuda
