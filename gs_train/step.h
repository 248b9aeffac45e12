// SPDX-License-Identifier: Apache-2.0
// What one training step takes: its photos, how they are compared, and what it updates.
#pragma once

#include "gs_core/math/constants.h"
#include "gs_core/math/density/growth.h"
#include "gs_core/scene.h"
#include "gs_render/render_pass.h"
#include "gs_train/loss.h"
#include "gs_train/update.h"

namespace gs {

/// What density control adds to one step, besides the update by the photos' gradients.
struct DensityStep {
  bool gather_statistics = false;  // of visibility and image-plane gradients
  Regularizers regularizers = {};  // in the loss
  PositionNoise noise = {};        // on the means, after the update
  bool absolute_gradient =
      false;  // statistics sum absolute values over pixels, as "absgs" has them
  // With the statistics, the sums over fragments of the score "force"
  GrowthScore score = GrowthScore::gradient;

  FragmentStatistic fragment_statistic() const {
    return gather_statistics && score == GrowthScore::force ? FragmentStatistic::force
                                                            : FragmentStatistic::none;
  }
};

/// One photo of a step: its view, and how it is rendered.
struct TrainingPhoto {
  const View* view;
  RenderSettings settings;
  int reduction = 1;          // camera and photo are reduced so many times (math/area_filter.h)
  std::size_t photo_row = 0;  // of TrainingModel::photometric and poses
  // With a loss of photos (SurfaceWeights): a photo beside it, reduced as often; null: it has none.
  const View* neighbor = nullptr;
  int patch_phase = 0;  // which pixels have patches; below kPatchStride^2
};

/// One step. What the spans point to outlives the call that takes it.
struct TrainingStep {
  Span<const TrainingPhoto> photos;  // 1 to kMostBatch; their gradients are summed in this order
  LossSettings loss;
  Update update;
  DensityStep density = {};
};

}  // namespace gs
