// SPDX-License-Identifier: Apache-2.0
// Stage 8 where SH is updated lazily: the table of missed updates, which each update extends, and
// the rows that catch up all at once.
#include "cuda/device/warp.cuh"
#include "cuda/render/lazy_rows.cuh"
#include "cuda/stages.cuh"

namespace gs::cuda {
namespace {

constexpr int kThreads = 256;  // rows and numbers are independent

__device__ bool is_halted(const std::uint32_t* halted) { return halted && *halted; }

// Entry `updates` begins with this update, which the entries before it have, too.
__global__ void extend_missed_kernel(MissedUpdates* missed, std::uint32_t updates,
                                     UnseenUpdate update, const std::uint32_t* halted) {
  const std::uint32_t k = blockIdx.x * kThreads + threadIdx.x;
  if (k > updates || is_halted(halted)) return;
  MissedUpdates sums;
  if (k < updates) sums = missed[k];
  add_update(sums, update);
  missed[k] = sums;
}

// The numbers of one quantity of all rows.
struct LazyArray {
  float* parameters;
  MomentNumbers moments;
  std::size_t size;  // numbers
  int quantity, place;
};

// `changes_moments`: else only the parameters catch up, which are copies.
template <int kInRow>
__global__ void catch_up_kernel(LazyArray array, LazyColors lazy, MomentRounding rounding,
                                bool changes_moments, const std::uint32_t* halted) {
  const std::size_t i = std::size_t(blockIdx.x) * kThreads + threadIdx.x;
  if (i >= array.size || is_halted(halted)) return;
  const std::size_t row = i / kInRow;
  if (!lazy.is_late(row)) return;
  const CatchUp missed = lazy.missed[lazy.updated_at[row]].catch_up;
  float m, v;
  array.moments.load(i, m, v);
  catch_up(array.parameters[i], m, v, missed, array.quantity);
  if (!changes_moments) return;
  std::uint32_t random = 0;
  if (array.moments.are_codes())
    random = random_of_number(rounding.of_row(row), array.place + int(i % kInRow));
  array.moments.store(i, m, v, random);
}

__global__ void clear_updates_kernel(Span<std::uint32_t> updated_at, const std::uint32_t* halted) {
  const std::size_t i = std::size_t(blockIdx.x) * kThreads + threadIdx.x;
  if (i < updated_at.size && !is_halted(halted)) updated_at[i] = 0;
}

void catch_up_arrays(Context& context, const TrainingModel& model, const LazySh& late,
                     const MomentRounding& rounding, bool changes_moments,
                     const std::uint32_t* halted) {
  const LazyColors lazy = lazy_colors(late);
  for_each_lazy_array(
      [&]<class Row>(LazyQuantity quantity, const Buffer<Row>& rows, int place,
                     const auto&... moments) {
        const Span<float> numbers = numbers_of(rows);
        const LazyArray array{numbers.data, moment_numbers(late.moments.form, moments...),
                              numbers.size, quantity, place};
        context.launch("lazy Adam", catch_up_kernel<int(sizeof(Row) / sizeof(float))>,
                       blocks_for(numbers.size, kThreads), kThreads, array, lazy, rounding,
                       changes_moments, halted);
      },
      model.gaussians, number_places(), late.moments.first, late.moments.second,
      late.moments.compact, late.moments.tiny);
}

}  // namespace

void extend_missed(Context& context, const LazyState& lazy, std::uint32_t updates,
                   const UnseenUpdate& update, const std::uint32_t* halted) {
  GS_CHECK(updates < std::uint32_t(kLazyWindow));
  context.launch("lazy Adam", extend_missed_kernel, blocks_for(updates + 1, kThreads), kThreads,
                 lazy.missed.data(), updates, update, halted);
}

void catch_up_sh(Context& context, const TrainingModel& model, const LazySh& late,
                 const MomentRounding& rounding, const std::uint32_t* halted) {
  const StageScope scope(context, "catch up");
  catch_up_arrays(context, model, late, rounding, true, halted);
  context.launch("lazy Adam", clear_updates_kernel, blocks_for(model.count(), kThreads), kThreads,
                 model.lazy.updated_at.span(), halted);
}

void catch_up_sh(Context& context, TrainingModel& model) {
  LazyState& lazy = model.lazy;
  if (!lazy.is_on || lazy.updates == 0) return;
  catch_up_sh(context, model, lazy_sh_of(model), {lazy.rounding_seed, model.adam_steps}, nullptr);
  lazy.updates = 0;
}

void show_current_sh(Context& context, const TrainingModel& model) {
  if (!model.lazy.is_on) return;
  catch_up_arrays(context, model, lazy_sh_of(model), {}, false, nullptr);
}

}  // namespace gs::cuda
