// SPDX-License-Identifier: Apache-2.0
// What stage 7 needs of the photos of a batch that are pulled back together.
#pragma once

#include <vector>

#include "cuda/stages.cuh"
#include "gs_core/training_memory.h"

namespace gs::cuda {

/// A photo of a batch after stage 6. Its arrays have the rows of the whole model.
struct PhotoRows {
  Camera camera;
  RenderSettings settings;
  const Splat* splats;               // (N)
  const std::uint32_t* tile_counts;  // (N)
  SplatGradientSum* gradients;       // (N)  zero once they are pulled back
  float force_scale;                 // force_scale() of its pass

  PhotoRows(const Camera& camera_, const RenderSettings& settings_, const Workspace& workspace,
            const RenderPass& pass)
      : camera(camera_), settings(settings_), splats(pass.splats.data()),
        tile_counts(pass.tile_counts.data()), gradients(workspace.splat_gradients.data()),
        force_scale(cuda::force_scale(pass)) {}
};

/// The photos of a batch that were drawn with one pass and wait to be pulled back. The arrays of a
/// photo stay where they are while others are drawn into other buffers.
class KeptPhotos {
 public:
  explicit KeptPhotos(Memory& memory) : memory_(memory) {}
  /// At the begin of a batch.
  void begin() { photos_.clear(); }
  /// Keeps a photo. Where another one will be drawn before the update (`is_followed`), the pass and
  /// the workspace get other buffers for it.
  void keep(const PhotoRows& photo, bool is_followed, Workspace& workspace, RenderPass& pass) {
    photos_.push_back(photo);
    if (!is_followed) return;
    while (buffers_.size() < photos_.size()) buffers_.emplace_back(memory_);
    buffers_[photos_.size() - 1].exchange(workspace, pass);
  }
  Span<const PhotoRows> photos() const { return {photos_.data(), photos_.size()}; }
  /// After a step that failed.
  void clear_gradients() {
    for (Buffers& buffers : buffers_) buffers.gradients.fill_zero();
  }
  /// Between steps.
  void release() {
    photos_.clear();
    buffers_.clear();
  }

 private:
  // The arrays of one photo.
  struct Buffers {
    Buffer<Splat> splats;
    Buffer<std::uint32_t> tile_counts;
    Buffer<SplatGradientSum> gradients;  // zero between steps
    explicit Buffers(Memory& memory) : splats(memory), tile_counts(memory), gradients(memory) {}
    void exchange(Workspace& workspace, RenderPass& pass) {
      splats.swap(pass.splats);
      tile_counts.swap(pass.tile_counts);
      gradients.swap(workspace.splat_gradients);
    }
  };
  Memory& memory_;
  std::vector<PhotoRows> photos_;
  std::vector<Buffers> buffers_;
};

/// True where update_by_photos() takes a batch. In other batches preprocess_backward_and_add() adds
/// the gradients of one photo after another to sums: in larger ones, in space and time, with lazy
/// updates, refined poses or depth maps, and with scores whose sums have arrays of their own.
inline bool are_pulled_back_together(const TrainingModel& model, Span<const TrainingPhoto> batch,
                                     const LossSettings& loss_settings,
                                     const DensityStep& density) {
  if (batch.size < 2 || batch.size > std::size_t(kMostTogether) || model.gaussians.has_time ||
      model.lazy.is_on || !model.poses.empty() || loss_settings.depth_weight > 0)
    return false;
  RenderSettings settings = batch[0].settings;
  settings.fragment_statistic = density.fragment_statistic();
  return settings.fragment_statistic == FragmentStatistic::none ||
         sums_of_forces_are_added(settings, density.pooling);
}

}  // namespace gs::cuda
