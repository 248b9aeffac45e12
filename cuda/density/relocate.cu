// SPDX-License-Identifier: Apache-2.0
// Stage 9 under the MCMC strategy: dead rows become copies of live ones, and copies are added up to
// a count. Weights are integers, so that their sums do not depend on the order of additions and
// equal those of the scalar twin. A draw is a binary search in the sums.
#include "cuda/density/relocate.cuh"

#include <thrust/iterator/counting_iterator.h>

#include <cub/device/device_scan.cuh>
#include <cub/device/device_select.cuh>

#include "cuda/density/rows.cuh"
#include "cuda/device/cub_scratch.cuh"
#include "cuda/stages.cuh"
#include "gs_train/row_rules.h"

namespace gs::cuda {
namespace {

__global__ void weights_kernel(GaussiansSpan rows, RelocationRules rules,
                               Span<std::uint64_t> weights) {
  const std::size_t i = row_of_thread();
  if (i >= weights.size) return;
  weights[i] = draw_weight(rows, i, rules.dead_opacity, rules.region);
}

/// True for rows without a weight; for CUB.
struct IsDead {
  const std::uint64_t* sums;
  __device__ bool operator()(std::uint32_t i) const { return sums[i] == (i > 0 ? sums[i - 1] : 0); }
};

/// The first row whose sum is above `at`.
__device__ std::uint32_t row_of(Span<const std::uint64_t> sums, std::uint64_t at) {
  std::size_t low = 0, high = sums.size - 1;  // the row exists, since `at` is below the last sum
  while (low < high) {
    const std::size_t middle = (low + high) / 2;
    if (sums[middle] > at)
      high = middle;
    else
      low = middle + 1;
  }
  return std::uint32_t(low);
}

__global__ void draw_kernel(Span<const std::uint64_t> sums, Random random, int step,
                            Span<std::uint32_t> source, std::uint32_t* drawn) {
  const std::size_t k = row_of_thread();
  if (k >= source.size) return;
  const std::uint64_t at =
      random.below64(sums[sums.size - 1], std::uint64_t(step), std::uint32_t(k));
  source[k] = row_of(sums, at);
  atomicAdd(&drawn[source[k]], 1u);
}

__global__ void count_kernel(Span<const std::uint32_t> source, std::uint32_t* drawn) {
  const std::size_t k = row_of_thread();
  if (k < source.size) atomicAdd(&drawn[source[k]], 1u);
}

// Each row that was drawn becomes one of its copies: opacity and scale are shared among them.
__global__ void share_kernel(GaussiansSpan rows, Span<const std::uint32_t> drawn,
                             float least_opacity) {
  const std::size_t i = row_of_thread();
  if (i >= drawn.size || drawn[i] == 0) return;
  const int copies = int(min_of(drawn[i], std::uint32_t(kMostCopies))) + 1;
  const SharedGaussian shared =
      shared_gaussian(rows.logit_opacity[i], rows.log_scale[i], copies, least_opacity);
  rows.logit_opacity[i] = shared.logit_opacity;
  rows.log_scale[i] = shared.log_scale;
}

// Rows of so many words: row to[k], or first + k where `to` is null, becomes row source[k], or
// zero.
template <class Word>
__global__ void set_rows_kernel(Word* rows, unsigned words, Span<const std::uint32_t> source,
                                bool is_zero, const std::uint32_t* to, std::size_t first) {
  const std::size_t item = row_of_thread(), k = item / words, word = item % words;
  if (k >= source.size) return;
  const std::size_t row = to ? to[k] : first + k;
  rows[row * words + word] = is_zero ? Word(0) : rows[std::size_t(source[k]) * words + word];
}

}  // namespace

// One thread for each of `count` items.
template <class... Parameters, class... Arguments>
void Relocation::launch(void (*kernel)(Parameters...), std::size_t count,
                        Arguments&&... arguments) {
  launch_rows(context_, "relocate", kernel, count, std::forward<Arguments>(arguments)...);
}

// Fills sums_ and returns the last of them. Waits.
std::uint64_t Relocation::sum_weights(const TrainingModel& model, const RelocationRules& rules) {
  const std::size_t count = model.count();
  sums_.resize_discard(count);
  if (count == 0) return 0;
  launch(weights_kernel, count, model.gaussians.span(), rules, sums_.span());
  with_cub_scratch(cub_, "relocate", [&](void* scratch, std::size_t& bytes) {
    return cub::DeviceScan::InclusiveSum(scratch, bytes, sums_.data(), sums_.data(), int(count),
                                         context_.stream());
  });
  std::uint64_t total = 0;
  sums_.memory().download(&total, sums_.data() + count - 1, sizeof total);
  return total;
}

// Lists the dead rows in dead_, in order. Waits.
std::size_t Relocation::find_dead() {
  const std::size_t count = sums_.size();
  dead_.resize_discard(count);
  with_cub_scratch(cub_, "relocate", [&](void* scratch, std::size_t& bytes) {
    return cub::DeviceSelect::If(scratch, bytes, thrust::counting_iterator<std::uint32_t>(0),
                                 dead_.data(), dead_count_.data(), int(count), IsDead{sums_.data()},
                                 context_.stream());
  });
  dead_.resize(dead_count_.download()[0]);
  return dead_.size();
}

// Fills source_, and drawn_ of each row that there is now.
void Relocation::draw(std::size_t count, const Random& random, int step) {
  drawn_.resize_discard(sums_.size());
  drawn_.fill_zero();
  source_.resize_discard(count);
  launch(draw_kernel, count, Span<const std::uint64_t>(sums_.span()), random, step, source_.span(),
         drawn_.data());
}

// Sources become copies like the others, and start with zero moments.
void Relocation::share_sources(TrainingModel& model, float least_opacity) {
  launch(share_kernel, drawn_.size(), model.gaussians.span(),
         Span<const std::uint32_t>(drawn_.span()), least_opacity);
  set_rows(model, RowRole::moment, source_.data(), 0);
}

// Row to[k], or first + k where `to` is null, becomes a copy of its source, or zeros for moments.
void Relocation::set_rows(TrainingModel& model, RowRole role, const std::uint32_t* to,
                          std::size_t first) {
  for (const Column& column : model.columns())
    if (column.role == role)
      with_words(*column.rows, [&]<class Word>(Word* words, unsigned in_row) {
        launch(set_rows_kernel<Word>, source_.size() * in_row, words, in_row,
               Span<const std::uint32_t>(source_.span()), role == RowRole::moment, to, first);
      });
}

void Relocation::copy_rows(TrainingModel& model, const std::uint32_t* to, std::size_t first) {
  set_rows(model, RowRole::parameter, to, first);
  set_rows(model, RowRole::moment, to, first);
}

std::size_t Relocation::move_dead_rows(TrainingModel& model, const RelocationRules& rules,
                                       const Random& random, int step) {
  if (sum_weights(model, rules) == 0) return 0;
  const std::size_t dead = find_dead();
  if (dead == 0) return 0;
  draw(dead, random, step);
  share_sources(model, rules.dead_opacity);
  copy_rows(model, dead_.data(), 0);
  return dead;
}

std::size_t Relocation::add_copies(TrainingModel& model, const RelocationRules& rules,
                                   const Random& random, int step) {
  const std::size_t before = model.count();
  if (std::int64_t(before) >= rules.grow_to || sum_weights(model, rules) == 0) return 0;
  draw(std::size_t(rules.grow_to) - before, random, step);
  share_sources(model, rules.dead_opacity);
  resize_rows(model, before + source_.size());
  copy_rows(model, nullptr, before);
  return source_.size();
}

void Relocation::replace(TrainingModel& model, Span<const std::uint32_t> dead,
                         Span<const std::uint32_t> source, float least_opacity) {
  const auto upload = [](Span<const std::uint32_t> rows, Buffer<std::uint32_t>& to) {
    to.resize_discard(rows.size);
    to.memory().upload(to.data(), rows.data, rows.size * sizeof(std::uint32_t));
  };
  upload(dead, dead_);
  upload(source, source_);
  drawn_.resize_discard(model.count());
  drawn_.fill_zero();
  launch(count_kernel, source.size, Span<const std::uint32_t>(source_.span()), drawn_.data());
  share_sources(model, least_opacity);
  copy_rows(model, dead_.data(), 0);
}

RefineReport Relocation::run(TrainingModel& model, const RelocationRules& rules, std::uint64_t seed,
                             int step) {
  RefineReport report;
  report.moved = move_dead_rows(model, rules, {seed, RandomStream::relocate}, step);
  report.cloned = add_copies(model, rules, {seed, RandomStream::grow}, step);
  clear_columns(model, RowRole::statistic);
  return report;
}

}  // namespace gs::cuda
