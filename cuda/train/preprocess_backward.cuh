// SPDX-License-Identifier: Apache-2.0
// Stages 7 and 8: from dL/d(splat) to the gradients of the parameters. In training the update
// follows at once, so that no gradient of a parameter is stored. A thread pulls the gradient of one
// Gaussian back. The whole warp then writes the gradients or updates the parameters, one number of
// its 32 rows after another, in whole cache lines. All loads are issued at the start, so that the
// warp waits for memory only once.   Faster-GS, backward fused with Adam
//
// This file has what one photo (preprocess_backward.cu) and several (update_by_photos.cu) share.
#pragma once

#include <algorithm>

#include "cuda/render/sh_rows.cuh"
#include "cuda/stages.cuh"
#include "cuda/train/row_updates.cuh"
#include "cuda/train/updates_of_codes.cuh"
#include "gs_core/math/spacetime_splat.h"

namespace gs::cuda {

/// The SH rows of a warp in shared memory, and what goes along with moments that are codes.
template <class Numbers>
struct ShRows : CodeRows<Numbers::kHasCodes> {
  // of the parameters, and of moments that are floats; aligned for copies of 16 bytes
  alignas(16) float sh_rows[kFloatArrays<Numbers>][kWarp * kShRowNumbers];

  /// Of this lane's Gaussian.
  __device__ const Vec3f* coefficients() const {
    return reinterpret_cast<const Vec3f*>(sh_rows[0] + lane_of_thread() * kShRowNumbers);
  }
};

/// The whole warp: starts to copy its SH rows into shared memory, so that they arrive during other
/// work.
template <int degree, class Numbers>
__device__ void start_sh_rows(ShRows<Numbers>& shared, const Numbers& numbers, std::size_t first,
                              int rows) {
  if constexpr (degree > 0) {
    for (int a = 0; a < kFloatArrays<Numbers>; ++a)
      start_sh_copy<degree>(shared.sh_rows[a], numbers.arrays[a] + first * kShRowNumbers, rows);
    if constexpr (Numbers::kHasCodes)
      start_copy_of_codes<degree>(
          shared.sh_codes,
          reinterpret_cast<const std::uint16_t*>(numbers.arrays[1]) + first * kShRowNumbers, rows);
    __pipeline_commit();
  }
}

/// The whole warp: applies gradients to its SH rows, four numbers at a time where it can.
/// gradients.at<Vector>(k) has those of vector k of all rows, a float or a float4.
template <int degree, class Numbers, class Gradients>
__device__ void finish_sh_rows(const ShRows<Numbers>& shared, const Numbers& numbers,
                               std::size_t first, int rows, const Gradients& gradients) {
  if constexpr (degree == 0) return;
  using Place = NumberPlace<ShRows<Numbers>>;
  if (degree == kMaxShDegree && rows == kWarp) {
    const std::size_t base = first / 4 * kShRowNumbers;  // `first` is a multiple of 32
    for (int item = lane_of_thread(); item < kWarp * kShRowNumbers / 4; item += kWarp) {
      float4 loaded[Numbers::kArrays];
      load_sh(shared, numbers, item, loaded);
      numbers.finish(
          base + item, loaded, gradients.template at<float4>(item),
          Place{shared, 4 * item / kShRowNumbers, 4 * item % kShRowNumbers, kShRowNumbers});
    }
    return;
  }
  constexpr int kInUse = std::max(kShNumbersInUse<degree>, 1);
  for (int item = lane_of_thread(); item < rows * kInUse; item += kWarp) {
    const int row = item / kInUse, number = item % kInUse, at = row * kShRowNumbers + number;
    float loaded[Numbers::kArrays];
    load_sh(shared, numbers, at, loaded);
    numbers.finish(first * kShRowNumbers + at, loaded, gradients.template at<float>(at),
                   Place{shared, row, number, kShRowNumbers});
  }
}

/// dL/d(parameters) of a visible Gaussian, without the color's part.
__device__ inline Row<false> pull_back(const Camera& camera, const Row<false>& row,
                                       float filter_scale, const SplatSettings& settings,
                                       const SplatGradient& dL_dsplat) {
  Row<false> gradient;
  gradient.take(
      project_shape_vjp(camera, row.vector(Quantity::mean), row.vector(Quantity::log_scale),
                        row.quaternion(Quantity::rotation), row.number(Quantity::logit_opacity),
                        filter_scale, settings, dL_dsplat));
  return gradient;
}
/// The same in space and time. `by_color` is the color's part of dL/d(mean at the moment).
__device__ inline Row<true> pull_back(const Camera& camera, const Row<true>& row,
                                      const SplatSettings& settings, const SplatGradient& dL_dsplat,
                                      const Vec3f& by_color) {
  Row<true> gradient;
  gradient.take(
      project_shape_vjp(camera, row.in_spacetime(), camera.time, settings, dL_dsplat, by_color));
  return gradient;
}

/// What updates the model, whose moments have this form. `photo` says how large a photo is, which
/// counts where there is one.
template <class Numbers>
UpdateByAdam<Numbers> update_of(const TrainingModel& model, const ModelUpdate& update,
                                const PhotoRows& photo, bool adds_forces,
                                const std::uint32_t* halted, const Shard& shard) {
  const DensityStatistics& statistics = model.statistics;
  const bool gathers = update.density.gather_statistics;
  const Regularizers of_each =
      update.density.regularizers.of_each(shard.count_of_all(model.count()));
  UpdateByAdam<Numbers> sink{
      {gathers ? statistics.visits.data() : nullptr, statistics.gradient_norm.data(),
       photo.camera.width, photo.camera.height, halted,
       adds_forces ? statistics.sums.data() : nullptr, force_scale(photo.pixel_count())},
      {},
      update.rounding,
      gathers && photo.settings.absolute_gradient,
      of_each.any(),
      of_each};
  int quantity = 0;
  for_each_array(
      [&](const char*, const auto& parameters, const auto& m, const auto& v, const auto& codes,
          const AdamStep& step, int place) {
        Numbers& numbers = sink.of[quantity++];
        if constexpr (Numbers::kHasCodes)
          numbers = {{numbers_of(parameters), numbers_of(codes)}, step, update.rule, place};
        else
          numbers = {{numbers_of(parameters), numbers_of(m), numbers_of(v)}, step, update.rule};
      },
      model.gaussians.span(), model.first_moment.span(), model.second_moment.span(),
      model.codes.span(), update.adam, number_places());
  return sink;
}
/// Calls f(sink) with it.
template <class F>
void with_update(const TrainingModel& model, const ModelUpdate& update, const PhotoRows& photo,
                 bool adds_forces, const std::uint32_t* halted, const Shard& shard, F&& f) {
  if (model.moment_form == MomentForm::tiny)
    f(update_of<AdamCodes>(model, update, photo, adds_forces, halted, shard));
  else
    f(update_of<AdamNumbers>(model, update, photo, adds_forces, halted, shard));
}

/// update_by_photos() for one photo  preprocess_backward.cu.
void update_by_photo(Context& context, TrainingModel& model, const PhotoRows& photo,
                     const ModelUpdate& update, const std::uint32_t* halted, const Shard& shard);

}  // namespace gs::cuda
