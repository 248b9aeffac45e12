// SPDX-License-Identifier: Apache-2.0
// A backend: what one device, or several of them, compute of training.
#pragma once

#include <memory>
#include <string>

#include "gs_core/math/density/pixel_rule.h"
#include "gs_render/renderer.h"
#include "gs_train/device.h"
#include "gs_train/features.h"
#include "gs_train/photometric/photometric_model.h"
#include "gs_train/row_ops.h"
#include "gs_train/step.h"
#include "gs_train/training_model.h"

namespace gs {

/// What a run chooses of a backend's features.
struct RunChoices {
  std::string loss = "l1_ssim";                                   // of Features::losses
  std::shared_ptr<const PhotometricModel> photometric = nullptr;  // null: none
  // In place of the loss, for one process. It compares pictures as they are, without a photometric
  // model.
  OwnLoss own_loss = {};
};

/// Everything that the trainer needs from a device. The program makes it; it outlives the trainer.
class Backend {
 public:
  explicit Backend(Features features) : features_(std::move(features)) {}
  virtual ~Backend() = default;
  const Features& features() const { return features_; }
  virtual Device& device() = 0;
  std::string name() { return device().name(); }
  Memory& memory() { return device().memory(); }
  virtual Renderer& renderer() = 0;
  virtual Loss& loss() = 0;
  /// What changes rows between steps. Ask for it anew after a step: on a GPU this waits for steps
  /// that may have to be repeated.
  virtual RowOps& rows() = 0;

  /// Takes the loss and the photometric model of a run from now on; check_supported() has passed
  /// its config. At first these are those of an empty RunChoices. A loss that stays keeps its last
  /// value.
  virtual void use(const RunChoices& choices) = 0;
  /// One training step: renders, compares and differentiates each photo, updates by the mean of
  /// their gradients, and does what density control adds. The statistics count each photo.
  /// train_step.cpp is the algorithm; a GPU has a fused sequence that computes the same. Where
  /// memory runs out it throws Error (out of memory) and has changed nothing, so that the step can
  /// be repeated.
  virtual void step(TrainingModel& model, const TrainingStep& step) = 0;
  /// A step by one photo.
  void step(TrainingModel& model, const View& view, const RenderSettings& settings,
            const LossSettings& loss_settings, const LearningRates& rates,
            const DensityStep& density) {
    const TrainingPhoto photo{&view, settings};
    step(model, {{&photo, 1}, loss_settings, {rates}, density});
  }
  /// A score pass: replaces the model's sums over fragments by those of the values that `rule` gives
  /// the pixels of these photos (FragmentSums). Nothing else changes. Call it after synchronize(),
  /// which brings the poses that steps have refined.
  virtual void score_photos(TrainingModel& model, Span<const TrainingPhoto> photos,
                            const PixelRule& rule) = 0;
  /// Waits until all steps so far have updated the model. A device runs steps asynchronously, so
  /// call this before you read a model. Row operations do it themselves.
  virtual void synchronize(TrainingModel& model) = 0;
  /// Releases buffers that are kept from step to step. The next step allocates them again.
  virtual void release_caches() = 0;

 private:
  const Features features_;
};

/// The scalar CPU backend. It is the reference: every other backend must compute the same.
std::unique_ptr<Backend> make_scalar_backend();

}  // namespace gs
