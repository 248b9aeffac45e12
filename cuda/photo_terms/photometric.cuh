// SPDX-License-Identifier: Apache-2.0
// The photometric model "gains" on the GPU: how a photo shows a pixel, the gradients of the photos
// of a step, and the update. Twin of gs_train/photometric/gains.cpp and
// gs_train/photo_terms/gains_term.cpp.
#pragma once

#include <memory>

#include "cuda/photo_terms/photo_table.cuh"
#include "gs_core/math/loss/photometric.h"
#include "gs_train/photometric/photometric_model.h"
#include "gs_train/step.h"

namespace gs::cuda {

/// How a photo shows the scene's colors. A kernel reads the numbers from the memory of the device,
/// because the host does not know what earlier steps have learned.
struct PhotoLook {
  const float* log_gains = nullptr;  // (3)

  explicit PhotoLook(const PhotoOnDevice* photo) {
    if (photo) log_gains = photo->photo;
  }

#ifdef __CUDACC__
  __device__ float photo_gain(int channel) const {
    return gained(1.0f, __ldg(log_gains + channel));
  }
#endif
};

/// Adds what the blocks of a loss have summed up over their pixels, in an order that is always the
/// same, to the gradient of a photo. Does nothing where the numbers rest.
///
/// of_blocks  sum G of each block, where G = dL/d(shown) * shown, weighted by the pixel's share.
///            The channel of block i is i % 3
void add_look_gradient(Context& context, Span<const float> of_blocks, const PhotoOnDevice& photo);

/// The photos of a batch may be drawn at the same time, by several GPUs. Each of them therefore
/// adds to a row of its own, and the rows are added up in the order of the batch: the sums have the
/// same bits wherever photos are drawn.
class PhotometricStage : public PhotoTableStage {
 public:
  /// `context` and `memory` are those of the GPU that has the model. `others_draw`: other processes
  /// draw photos, and share their rows.
  PhotometricStage(Context& context, Memory& memory, bool others_draw)
      : PhotoTableStage("photometric", context, memory), others_draw_(others_draw), rows_(memory) {}

  /// The photometric model of the run; null: none.
  void use(std::shared_ptr<const PhotometricModel> model) { model_ = std::move(model); }
  bool is_on() const { return model_ != nullptr; }
  PhotoTableUpdate update_of(const PhotometricState& state, const Update& update) const {
    if (!is_on()) return {};
    return PhotoTableStage::update_of(state, update.photometric_rate, update.photo_rule);
  }

  /// Before the photos of a step. Waits where the run is new.
  void begin(const PhotometricState& state, std::size_t photos);
  /// Photo i of a batch of `photos`.
  PhotoOnDevice photo(const PhotometricState& state, const PhotoTableUpdate& update,
                      const TrainingPhoto& photo, std::size_t i, std::size_t photos) const;
  /// The row of photo i of a batch; empty where the step has no update, or no rows.
  Span<double> row_of(const PhotometricState& state, const PhotoTableUpdate& update, std::size_t i,
                      std::size_t photos) const {
    if (!update.is_due || !has_rows(photos)) return {};
    return {rows_.data() + i * state.numbers, state.numbers};
  }
  /// After all photos of a batch.
  void update(PhotometricState& state, const PhotoTableUpdate& update,
              Span<const TrainingPhoto> batch, const std::uint32_t* halted);

  void clear_gradient() {
    PhotoTableStage::clear_gradient();
    rows_.fill_zero();
  }

 private:
  bool has_rows(std::size_t photos) const { return photos > 1 || others_draw_; }

  const bool others_draw_;
  std::shared_ptr<const PhotometricModel> model_;
  Buffer<double> rows_;  // (photos of a batch, numbers) zero between steps
};

}  // namespace gs::cuda
