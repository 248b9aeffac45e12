// SPDX-License-Identifier: Apache-2.0
// The photometric model of a run on a GPU: where the numbers of a photo are, the gradients of the
// photos of a step, and the update.
#pragma once

#include <string>

#include "cuda/photo_terms/photometric.cuh"
#include "gs_core/config/config.h"
#include "gs_train/backend.h"

namespace gs::cuda {

/// The update of the photometric model in one step; there is none while its numbers rest.
struct PhotometricUpdate {
  bool is_due = false;
  AdamStep adam{};
  AdamRule rule = {};
};

/// The photos of a batch may be drawn at the same time, by several GPUs. Each of them therefore
/// adds to a row of its own, and the rows are added up in the order of the batch: the sums have the
/// same bits wherever photos are drawn.
class PhotometricStage {
 public:
  /// `context` and `memory` are those of the GPU that has the model. `others_draw`: other processes
  /// draw photos, and share their rows.
  PhotometricStage(Context& context, Memory& memory, bool others_draw)
      : context_(context), others_draw_(others_draw), gradient_(memory), rows_(memory) {}

  /// From now on the run has gains, or has no photometric model.
  void turn(bool is_on) { is_on_ = is_on; }
  bool is_on() const { return is_on_; }
  PhotometricUpdate update_of(const PhotometricState& state, const Update& update) const;

  /// Before the photos of a step. The gradient is zero between steps. Waits where the run is new.
  void begin(const PhotometricState& state, std::size_t photos);
  /// Photo i of a batch of `photos`.
  PhotoOnDevice photo(const PhotometricState& state, const PhotometricUpdate& update,
                      const TrainingPhoto& photo, std::size_t i, std::size_t photos) const;
  /// The row of photo i of a batch; empty where the step has no update, or no rows.
  Span<double> row_of(const PhotometricState& state, const PhotometricUpdate& update, std::size_t i,
                      std::size_t photos) const {
    if (!update.is_due || !has_rows(photos)) return {};
    return {rows_.data() + i * state.shape.photo_size, state.shape.photo_size};
  }
  /// After all photos of a batch.
  void update(PhotometricState& state, const PhotometricUpdate& update,
              Span<const TrainingPhoto> batch, const std::uint32_t* halted);

  /// After steps that failed or were halted.
  void clear_gradients() {
    gradient_.fill_zero();
    rows_.fill_zero();
  }
  /// Between steps.
  void release_caches() {
    gradient_.release();
    rows_.release();
  }

 private:
  bool has_rows(std::size_t photos) const { return photos > 1 || others_draw_; }

  Context& context_;
  const bool others_draw_;
  bool is_on_ = false;
  Buffer<double> gradient_;  // (state.shape.size()) zero between steps
  Buffer<double> rows_;      // (photos of a batch, shape.photo_size) the same
};

}  // namespace gs::cuda
