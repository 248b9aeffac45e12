// SPDX-License-Identifier: Apache-2.0
// One training step on the CPU, which defines what every backend computes.
#pragma once

#include <memory>

#include "gs_render/renderer.h"
#include "gs_train/photo_terms/photo_term.h"
#include "gs_train/step.h"
#include "gs_train/training_model.h"

namespace gs {

/// What the steps of a run are computed with, and the arrays that they keep.
class StepStages {
 public:
  StepStages();

  std::unique_ptr<Renderer> renderer;  // stages 1-4, 6 and 7
  std::unique_ptr<Loss> loss;          // 5
  PhotoTerms terms;
  RenderPass pass;
  Buffer<float> dL_dimage;
  Gaussians gradients;       // of one photo
  Buffer<Vec2f> dL_dmean2d;  // (N) of one photo, pixels^-1

  /// The photo that a step or a score pass is at, loaded.
  StepPhoto load(const TrainingModel& model, const TrainingPhoto& photo, const LossSettings& loss,
                 FragmentStatistic statistic) const;
  /// Before the photos of a step: arrays have the model's rows, and sums are zero.
  void begin(TrainingModel& model, const TrainingStep& step);
  /// After stage 7 of a photo: adds its gradients and what density control looks at.
  void add_photo(TrainingModel& model, const TrainingStep& step);
  /// 8: regularizers, Adam and noise.
  void update(TrainingModel& model, const TrainingStep& step);
  void release_caches();

 private:
  // A batch of several photos is summed up beside the model, so that nothing has changed where
  // memory runs out in one of them.
  Gaussians sum_;
  DensityStatistics statistics_sum_;
};

void train_step(StepStages& on, TrainingModel& model, const TrainingStep& step);

}  // namespace gs
