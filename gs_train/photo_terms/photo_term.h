// SPDX-License-Identifier: Apache-2.0
// What a photo has in training besides its colors: a depth map, gains, a pose. This is the contract
// on the CPU; the twins are in cuda/photo_terms.
//
// To add a term:
//   1. The formulas go into gs_core/math, with their gradients. The class (derived from PhotoTerm)
//      goes into a file of this folder, with the function that makes it.
//   2. It becomes a row of kPhotoTerms in photo_terms.cpp.
//   3. What it learns is a PhotoTable in TrainingModel, as PhotometricState and PoseState are.
#pragma once

#include <memory>
#include <vector>

#include "gs_core/scene.h"
#include "gs_render/render_pass.h"
#include "gs_train/loss.h"
#include "gs_train/photometric/photometric_model.h"
#include "gs_train/step.h"
#include "gs_train/training_model.h"

namespace gs {

/// A photo of a step or of a score pass, as the stages see it.
struct StepPhoto {
  const TrainingPhoto& given;
  std::shared_ptr<const View> view;  // with its photo, which is reduced as `given` says
  Camera camera;                     // of the reduced photo
  RenderSettings settings;
  LossSettings loss;
  PictureGradient dL{};  // by the picture, of which the loss gives the image
};

/// The calls of a step, in their order; those between begin() and update() come for each photo. A
/// score pass calls prepare() and show() alone.
class PhotoTerm {
 public:
  virtual ~PhotoTerm() = default;
  /// Before the photos of a step: sums of gradients are zero.
  virtual void begin(const TrainingModel&, const Update&) {}
  /// Before stage 1: may change the camera and the settings of the photo.
  virtual void prepare(const TrainingModel&, StepPhoto&) {}
  /// After stage 4: may change what the loss compares, or give gradients by other pictures than the
  /// image.
  virtual void show(const TrainingModel&, StepPhoto&, RenderPass&) {}
  /// After stage 7: adds the gradient of what is learned of the photo, times `weight`.
  virtual void add_gradient(const TrainingModel&, const StepPhoto&, const RenderPass&,
                            [[maybe_unused]] double weight) {}
  /// With stage 8: one update by the sum of the gradients.
  virtual void update(TrainingModel&, const Update&) {}
};
using PhotoTerms = std::vector<std::unique_ptr<PhotoTerm>>;

/// All terms, of which those do nothing that a run does not use. `photometric` may be null.
PhotoTerms make_photo_terms(const std::shared_ptr<const PhotometricModel>& photometric);

using MakePhotoTerm =
    std::unique_ptr<PhotoTerm>(const std::shared_ptr<const PhotometricModel>& photometric);
MakePhotoTerm make_depth_term, make_gains_term, make_pose_term, make_surface_term;

}  // namespace gs
