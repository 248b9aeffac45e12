// SPDX-License-Identifier: Apache-2.0
// How a step gathers gradients: which batches are done together (photo_rows.cuh), and where the
// sums of a score that sums over fragments are kept.
#pragma once

#include "gs_core/training_memory.h"
#include "gs_train/backend.h"

namespace gs::cuda {

/// True where the sums over fragments find room in Workspace::splat_gradients.
inline bool sums_among_gradients(const RenderSettings& settings) {
  return settings.fragment_statistic == FragmentStatistic::force && !settings.deterministic &&
         !settings.absolute_gradient;
}
/// True where preprocess_backward.cu adds such sums to the statistics, rather than
/// gather_fragment_sums(), which comes before a depth map adds to the gradients.
inline bool sums_of_forces_are_added(const RenderSettings& settings) {
  return sums_among_gradients(settings) && !settings.with_depths;
}

/// True where a photo is also compared with its depth map.
inline bool compares_depth(const TrainingPhoto& photo, const LossSettings& loss_settings) {
  return loss_settings.depth_weight > 0 && photo.view->has_depth_map;
}

/// True where stages 1, 7 and 8 are done for all photos of a batch together. In other batches
/// preprocess_backward_and_add() adds the gradients of one photo after another to sums: in larger
/// ones, in space and time, with refined poses or depth maps, and where the sums of forces have
/// an array of their own.
inline bool are_done_together(const TrainingModel& model, Span<const TrainingPhoto> batch,
                              const LossSettings& loss_settings, const DensityStep& density) {
  if (batch.size < 2 || batch.size > std::size_t(kMostTogether) || model.gaussians.has_time ||
      !model.poses.empty())
    return false;
  for (const TrainingPhoto& photo : batch)
    if (compares_depth(photo, loss_settings)) return false;
  RenderSettings settings = batch[0].settings;
  settings.fragment_statistic = density.fragment_statistic();
  settings.with_depths = false;
  return settings.fragment_statistic == FragmentStatistic::none ||
         sums_of_forces_are_added(settings);
}

}  // namespace gs::cuda
