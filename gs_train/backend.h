// SPDX-License-Identifier: Apache-2.0
// A backend: one device's renderer, loss, optimizer and row operations, and the coarse verb step().
#pragma once

#include <memory>
#include <string>
#include <vector>

#include "gs_render/renderer.h"
#include "gs_render/stage_clock.h"
#include "gs_train/loss.h"
#include "gs_train/optimizer.h"
#include "gs_train/row_ops.h"

namespace gs {

/// What density control asks of one step besides the update by the photo's gradients.
struct DensityStep {
  bool gather_statistics = false;  // of visibility and image-plane gradients
  Regularizers regularizers = {};  // in the loss
  PositionNoise noise = {};        // on the means, after the update
};

/// Everything that the trainer needs of a device. Made by the program, outlives the trainer.
class Backend {
 public:
  explicit Backend(Memory& memory)
      : pass_(memory), dL_dimage_(memory), dL_dmean2d_(memory), gradients_(memory) {}
  virtual ~Backend() = default;
  virtual std::string name() const = 0;  // as in results.json: "cpu", "cuda:0 (NVIDIA H200)"
  /// Makes its device the calling thread's: before work on a thread that may have used another GPU since.
  virtual void make_current() {}
  virtual Memory& memory() = 0;
  virtual Renderer& renderer() = 0;
  /// Takes the loss of this name, a word of loss.kind, from now on; at first it is l1_ssim. Throws UsageError where the
  /// backend lacks it.
  virtual void use_loss(const std::string& kind) = 0;
  virtual Loss& loss() = 0;
  virtual Optimizer& optimizer() = 0;
  virtual RowOps& rows() = 0;

  /// Tells of the views that steps will ask for, so that a device can fetch their photos beforehand, up to so
  /// many bytes of its memory. The views outlive the next upload_views() or the backend.
  virtual void upload_views(const std::vector<View>&, [[maybe_unused]] std::size_t photo_bytes) {}
  /// Tells of the views in the order in which steps will take them, some kPhotosAhead steps before: photos that are still
  /// files can be decoded meanwhile.
  virtual void prefetch_decode(const View& view) { prefetch_photo(view); }
  /// Tells which view the step after the next one will take.
  virtual void prefetch_next(const View&) {}

  /// One training step: render, compare, differentiate, update, and do what density control asks. The body given here is the algorithm in plain words; a backend may override it with a
  /// fused sequence that computes the same.
  virtual void step(TrainingModel& model, const View& view, const RenderSettings& settings,
                    const LossSettings& loss_settings, const LearningRates& rates,
                    const DensityStep& density);

  /// Waits until the model is what all steps so far make of it. Steps of a device run behind the host's back:
  /// whoever looks at a model calls this first; row operations do so themselves.
  virtual void synchronize(TrainingModel&) {}

  /// Gives back the memory that is held to be quick: what a step needs is asked for again. A step that failed for want
  /// of memory has changed nothing, and can be taken again.
  virtual void release_caches();

  /// While on, each stage's run is timed. On forgets what was timed before, and may wait for the device; off does neither.
  virtual void set_profiling(bool) {}
  /// The stages' times since it was last set on, in pipeline order; may wait for the device. Empty where the backend does not time stages.
  virtual std::vector<StageTime> stage_times() { return {}; }

 protected:
  /// The part of release_caches() that concerns what follows below.
  void release_pass();
  /// statistics += this step's visibility and image-plane gradients.
  virtual void gather(TrainingModel& model, const RenderPass& pass,
                      Span<const Vec2f> dL_dmean2d) = 0;

  RenderPass pass_;
  Buffer<float> dL_dimage_;
  Buffer<Vec2f> dL_dmean2d_;
  Gaussians gradients_;
};

/// The scalar CPU backend: it defines what every other one must compute.
std::unique_ptr<Backend> make_scalar_backend();

}  // namespace gs
