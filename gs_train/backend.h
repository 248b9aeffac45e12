// SPDX-License-Identifier: Apache-2.0
// A backend: the renderer, loss, optimizer and row operations of one device, and the coarse verb
// step().
#pragma once

#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "gs_core/math/density/pixel_rule.h"
#include "gs_render/renderer.h"
#include "gs_render/stage_clock.h"
#include "gs_train/loss.h"
#include "gs_train/optimizer.h"
#include "gs_train/photometric/photometric_model.h"
#include "gs_train/row_ops.h"

namespace gs {

/// What density control adds to one step, besides the update by the photo's gradients.
struct DensityStep {
  bool gather_statistics = false;  // of visibility and image-plane gradients
  Regularizers regularizers = {};  // in the loss
  PositionNoise noise = {};        // on the means, after the update
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
  std::optional<Camera> refined = {};  // in place of the view's camera

  const Camera& camera() const { return refined ? *refined : view->camera; }
};

/// Everything that the trainer needs from a device. The program makes it; it outlives the trainer.
class Backend {
 public:
  explicit Backend(Memory& memory)
      : pass_(memory), dL_dimage_(memory), depth_planes_(memory), dL_dplanes_(memory),
        dL_dmean2d_(memory), gradients_(memory), sum_(memory), statistics_sum_(memory) {}
  virtual ~Backend() = default;
  virtual std::string name() const = 0;  // as in results.json: "cpu", "cuda:0 (NVIDIA H200)"
  /// Makes its device the current one of the calling thread. A thread that may have used another
  /// GPU calls it before it works with this backend.
  virtual void make_current() {}
  virtual Memory& memory() = 0;
  virtual Renderer& renderer() = 0;
  /// Takes the loss of this name, a word of loss.kind, from now on; at first it is l1_ssim. Throws
  /// UsageError where the backend lacks it.
  virtual void use_loss(const std::string& kind) = 0;
  virtual Loss& loss() = 0;
  /// Takes a photometric model from now on, for models that have its numbers; at first there is none.
  /// Null: none. Throws UsageError where the backend or its loss lacks it.
  virtual void use_photometric(std::shared_ptr<const PhotometricModel> photometric) = 0;
  /// True where step() makes the cameras of training photos from model.poses itself. Else the
  /// caller gives them with the photos (TrainingPhoto::refined), as they are after the last step.
  virtual bool makes_refined_cameras() const { return false; }
  /// True where other processes take the same steps of the same model. Then this one cannot go back
  /// or take other steps than they do.
  virtual bool is_shared() const { return false; }
  virtual Optimizer& optimizer() = 0;
  /// What changes rows between steps. Ask for it anew after a step: on a GPU this waits for steps
  /// that may have to be repeated.
  virtual RowOps& rows() = 0;

  /// Announces the views that steps will use, so that a device can upload their photos, up to
  /// `photo_bytes` of its memory. The views live until the next upload_views(), or as long as the
  /// backend.
  virtual void upload_views(const std::vector<View>&, [[maybe_unused]] std::size_t photo_bytes) {}
  /// Announces a view about kPhotosAhead steps before its step, so that its photo can be decoded in
  /// the background. Called in the order of the steps.
  virtual void prefetch_decode(const View& view) { prefetch_photo(view); }
  /// Announces the view with which the step after the next one begins, so that its photo can be
  /// uploaded during the next one.
  virtual void prefetch_next(const View&) {}

  /// One training step: render, compare and differentiate each photo of a batch, update by the mean
  /// of their gradients, and what density control adds. The statistics count each photo. The body in
  /// backend.cpp is the algorithm, stage by stage; a backend may override it with a fused sequence
  /// that computes the same. Where memory runs out it throws Error (out of memory) and has changed
  /// nothing, so that the step can be repeated.
  ///
  /// batch   1 to kMostBatch photos; gradients are summed in their order
  virtual void step(TrainingModel& model, Span<const TrainingPhoto> batch,
                    const LossSettings& loss_settings, const Update& update,
                    const DensityStep& density);
  /// The same for one photo.
  void step(TrainingModel& model, const View& view, const RenderSettings& settings,
            const LossSettings& loss_settings, const LearningRates& rates,
            const DensityStep& density) {
    const TrainingPhoto photo{&view, settings};
    step(model, Span<const TrainingPhoto>{&photo, 1}, loss_settings, Update{rates}, density);
  }

  /// A score pass: replaces the model's sums over fragments by those of the values that `rule` gives
  /// the pixels of these photos (FragmentSums). Nothing else changes. Call it after synchronize(),
  /// which brings the refined poses that the photos have.
  virtual void score_photos(TrainingModel& model, Span<const TrainingPhoto> photos,
                            const PixelRule& rule);

  /// Waits until all steps so far have updated the model. A device runs steps asynchronously, so
  /// call this before you read a model. Row operations do it themselves.
  virtual void synchronize(TrainingModel&) {}

  /// Releases buffers that are kept from step to step. The next step allocates them again.
  virtual void release_caches();

  /// Starts or stops timing the stages. Starting discards earlier times and may wait for the
  /// device.
  virtual void set_profiling(bool) {}
  /// The times of the stages since timing was last started, in pipeline order. May wait for the
  /// device. Empty where the backend does not time stages.
  virtual std::vector<StageTime> stage_times() { return {}; }
  /// The clock of a device's processors while they are busy, in MHz, for benchmarks; may wait for
  /// the device. Nothing where it is not known.
  virtual std::optional<double> clock_mhz() { return std::nullopt; }

 protected:
  /// The part of release_caches() for the members below.
  void release_pass();
  /// Adds the sums of the values of the pixels of a photo, whose view the pass has rendered, to
  /// `to`, one for each Gaussian.
  virtual void add_pixel_scores(const View& view, const RenderSettings& settings,
                                const PixelRule& rule, RenderPass& pass, Span<FragmentSums> to) = 0;
  /// Blends depths with the lists of the pass, compares them with the view's map, and leaves the
  /// gradient with the pass, whose backward() adds it.
  virtual void compare_depth(const View& view, const RenderSettings& settings, float weight,
                             RenderPass& pass);
  /// statistics += the photo's visibility and image-plane gradients, and its sums over fragments,
  /// if there are any.
  virtual void gather(const DensityStatistics& statistics, const RenderPass& pass,
                      Span<const Vec2f> dL_dmean2d) = 0;
  /// to += weight * from.
  virtual void add(Span<float> to, Span<const float> from, float weight) = 0;
  /// to += from, which is undefined afterwards.
  virtual void add(Span<FragmentSums> to, Span<FragmentSums> from) = 0;

  void add(const Gaussians& to, const Gaussians& from, float weight);
  void add(const DensityStatistics& to, const DensityStatistics& from);
  /// Renders a photo's view, compares it with the photo, and pulls the gradients back: fills pass_,
  /// gradients_ and dL_dmean2d_.
  void differentiate_photo(const TrainingModel& model, const TrainingPhoto& photo,
                           const LossSettings& loss_settings, const DensityStep& density);
  /// The photo's view with its photo, reduced; its camera is the view's, not a refined one.
  static std::shared_ptr<const View> loaded_view(const TrainingPhoto& photo);
  /// How a step renders a photo.
  static RenderSettings settings_of(const TrainingPhoto& photo, const DensityStep& density);
  /// Compares the picture of a pass with its photo: fills dL_dimage_. With a depth map, compares
  /// depths first.
  void compare(const TrainingModel& model, const TrainingPhoto& photo, const View& view,
               const LossSettings& loss_settings, const DensityStep& density, RenderPass& pass);
  void prepare_sums(const TrainingModel& model);
  /// The appearance of a photo, which has shown the pass's picture; null without a model.
  std::unique_ptr<Appearance> appearance_of(const TrainingModel& model, const TrainingPhoto& photo,
                                            const View& view, const RenderPass& pass);
  /// Adds the gradient of the appearance of the photo that was differentiated, times `weight`.
  void add_photometric_gradient(const PhotometricShape& shape, const TrainingPhoto& photo,
                                double weight);
  /// Throws UsageError where the loss, a word of loss.kind, knows no photometric model.
  static void check_takes_appearance(const Loss& loss, const std::string& kind);
  /// One update by the sum of the gradients.
  virtual void update_photometric(PhotometricState& state, const Update& update,
                                  std::vector<double>& gradient);

  /// Adds the gradient of the pose of the photo that was differentiated, times `weight`.
  void add_camera_gradient(const TrainingModel& model, const TrainingPhoto& photo, double weight);
  /// dL by the camera of that photo, after backward() of its pass.
  virtual CameraGradient<double> camera_gradient(const GaussiansSpan& gaussians,
                                                 const Camera& camera,
                                                 const RenderSettings& settings,
                                                 const RenderPass& pass);

  std::shared_ptr<const PhotometricModel> photometric_;
  std::unique_ptr<Appearance> appearance_;  // of the photo that is differentiated or scored
  std::vector<double> photometric_sum_;     // of a batch
  std::vector<double> pose_sum_;            // of a batch; empty while poses rest
  RenderPass pass_;
  Buffer<float> dL_dimage_;
  Buffer<float> depth_planes_, dL_dplanes_;  // of photos with a depth map; else empty
  Buffer<Vec2f> dL_dmean2d_;
  Gaussians gradients_;               // of one photo
  Gaussians sum_;                     // of a batch: the mean gradients of its photos so far
  DensityStatistics statistics_sum_;  // of a batch
};

/// The scalar CPU backend. It is the reference: every other backend must compute the same.
std::unique_ptr<Backend> make_scalar_backend();

}  // namespace gs
