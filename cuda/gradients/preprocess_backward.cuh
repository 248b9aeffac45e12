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

#include "cuda/gradients/row_updates.cuh"
#include "cuda/render/sh_rows.cuh"
#include "cuda/stages.cuh"
#include "gs_core/math/spacetime/spacetime_splat.h"

namespace gs::cuda {

/// The whole warp: starts to copy its SH rows into shared memory, so that they arrive during other
/// work.
template <int degree, class Values>
__device__ void start_sh_rows(ShRows<typename Values::Stored>& shared, const Values& numbers,
                              std::size_t first, int rows) {
  if constexpr (degree > 0) {
    start_sh_copy<degree>(shared.parameters, numbers.parameters + first * kShRowNumbers, rows);
    if constexpr (kHasMoments<typename Values::Stored>)
      start_sh_copy<degree>(shared.moments, numbers.moments + first * kShRowNumbers, rows);
    __pipeline_commit();
  }
}

/// The whole warp: applies gradients to its SH rows, several numbers at a time where it can.
/// gradients.at<count>(k) has those of vector k of `count` numbers of all rows.
template <int degree, class Values, class Gradients>
__device__ void finish_sh_rows(const ShRows<typename Values::Stored>& shared, const Values& numbers,
                               std::size_t first, int rows, const Gradients& gradients) {
  if constexpr (degree == 0) return;
  using Stored = typename Values::Stored;
  if (degree == kMaxShDegree && rows == kWarp) {
    constexpr int kCount = Values::kNeighbors;
    const std::size_t base = first / kCount * kShRowNumbers;  // `first` is a multiple of 32
    for (int item = lane_of_thread(); item < kWarp * kShRowNumbers / kCount; item += kWarp)
      numbers.template finish<kCount>(
          base + item, reinterpret_cast<const Few<float, kCount>*>(shared.parameters)[item],
          reinterpret_cast<const Few<Stored, kCount>*>(shared.moments)[item],
          gradients.template at<kCount>(item),
          ValueIndex{shared.random, kCount * item / kShRowNumbers, kCount * item % kShRowNumbers,
                     kShRowNumbers});
    return;
  }
  constexpr int kInUse = std::max(kShNumbersInUse<degree>, 1);
  for (int item = lane_of_thread(); item < rows * kInUse; item += kWarp) {
    const int row = item / kInUse, number = item % kInUse, at = row * kShRowNumbers + number;
    numbers.template finish<1>(first * kShRowNumbers + at, {shared.parameters[at]},
                               {shared.moments[at]}, gradients.template at<1>(at),
                               ValueIndex{shared.random, row, number, kShRowNumbers});
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
/// Pulls back a Gaussian in space and time. `by_color` is the color's part of dL/d(mean at the
/// moment).
__device__ inline Row<true> pull_back(const Camera& camera, const Row<true>& row,
                                      const SplatSettings& settings, const SplatGradient& dL_dsplat,
                                      const Vec3f& by_color) {
  Row<true> gradient;
  gradient.take(
      project_shape_vjp(camera, row.in_spacetime(), camera.time, settings, dL_dsplat, by_color));
  return gradient;
}

/// What updates the model. `photo` says how large a photo is, which counts where there is one.
template <class Stored>
UpdateByAdam<AdamValues<Stored>> update_of(const TrainingModel& model,
                                           const AdamMoments<Stored>& moments,
                                           const ModelUpdate& update, const PhotoRows& photo,
                                           bool adds_forces, const std::uint32_t* halted,
                                           const Shard& shard) {
  const DensityStatistics& statistics = model.statistics;
  const bool gathers = update.density.gather_statistics;
  const Regularizers of_each =
      update.density.regularizers.of_each(shard.count_of_all(model.count()));
  UpdateByAdam<AdamValues<Stored>> target{
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
      [&](const char*, const auto& parameters, const auto& of_parameters, const AdamStep& step,
          int random_offset) {
        target.of[quantity++] = {numbers_of(parameters).data, moments_in(of_parameters).data, step,
                                 update.rule, random_offset};
      },
      model.gaussians, moments, update.adam, kRandomOffsets);
  return target;
}
/// Calls f(target) with it.
template <class F>
void with_update(const TrainingModel& model, const ModelUpdate& update, const PhotoRows& photo,
                 bool adds_forces, const std::uint32_t* halted, const Shard& shard, F&& f) {
  std::visit(
      [&](const auto& moments) {
        f(update_of(model, moments, update, photo, adds_forces, halted, shard));
      },
      model.moments);
}

/// update_by_photos() for one photo  preprocess_backward.cu.
void update_by_photo(Context& context, TrainingModel& model, const PhotoRows& photo,
                     const ModelUpdate& update, const std::uint32_t* halted, const Shard& shard,
                     const GaussianShape<float>* shape_gradients);

}  // namespace gs::cuda
