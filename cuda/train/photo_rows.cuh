// SPDX-License-Identifier: Apache-2.0
// Batches of a few photos. What works on rows of the model, stages 1, 7 and 8, is done for all
// photos at once: preprocess_batch() and update_by_photos(). Stages 2 to 6 draw one photo after
// another in between. The arrays of a photo that both ends need are therefore kept for each photo.
// batch_choice.h says which batches these are.
#pragma once

#include <vector>

#include "cuda/render/renderer.cuh"
#include "cuda/stages.cuh"

namespace gs::cuda {

/// A photo of a batch. Its arrays have the rows of the whole model.
struct PhotoRows {
  Camera camera;
  RenderSettings settings;
  Splat* splats;                // (N)
  Rect* pixel_rects;            // (N)
  std::uint32_t* tile_counts;   // (N)
  std::uint32_t* depth_keys;    // (N)
  SplatGradientSum* gradients;  // (N)  zero once they are pulled back

  PhotoRows(const Camera& camera_, const RenderSettings& settings_, const Buffer<Splat>& splats_,
            const Buffer<Rect>& pixel_rects_, const Buffer<std::uint32_t>& tile_counts_,
            const Buffer<std::uint32_t>& depth_keys_, const Buffer<SplatGradientSum>& gradients_)
      : camera(camera_), settings(settings_), splats(splats_.data()),
        pixel_rects(pixel_rects_.data()), tile_counts(tile_counts_.data()),
        depth_keys(depth_keys_.data()), gradients(gradients_.data()) {}
};

/// The arrays of the photos of a batch that are drawn with one pass. Those of the first photo are
/// the pass's and the workspace's own.
class PhotoBuffers {
 public:
  explicit PhotoBuffers(Memory& memory) : memory_(memory) {}

  /// The arrays of photo `i` of those that the pass draws, before any of them is drawn. Gradients
  /// are zero. `draws` as in CudaRenderer::reserve_gradients().
  PhotoRows rows(std::size_t i, const Camera& camera, const RenderSettings& settings,
                 std::size_t count, CudaRenderer& renderer, RenderPass& pass, bool draws = true) {
    Workspace& workspace = renderer.workspace();
    if (i == 0) {
      pass.begin(camera, count, true, false);
      workspace.depth_keys.resize_discard(count);
      renderer.reserve_gradients(count, settings, draws);
      return {camera,
              settings,
              pass.splats,
              pass.pixel_rects,
              pass.tile_counts,
              workspace.depth_keys,
              workspace.splat_gradients};
    }
    while (others_.size() < i) others_.emplace_back(memory_);
    Arrays& arrays = others_[i - 1];
    arrays.reserve(count);
    return {camera,
            settings,
            arrays.splats,
            arrays.pixel_rects,
            arrays.tile_counts,
            arrays.depth_keys,
            arrays.gradients};
  }
  /// Gives pass and workspace the arrays of photo `i`, which is drawn next; photos are drawn in
  /// order. Arrays stay where they are in memory.
  void select(std::size_t i, const Camera& camera, std::size_t count, CudaRenderer& renderer,
              RenderPass& pass) {
    if (i > 0) others_[i - 1].exchange(renderer.workspace(), pass);
    pass.begin(camera, count, true, false);
    pass.scratch<CudaScratch>().has_view_splats = false;
  }
  /// After a step that failed.
  void clear_gradients() {
    for (Arrays& arrays : others_) arrays.gradients.fill_zero();
  }
  /// Between steps.
  void release() { others_.clear(); }

 private:
  struct Arrays {
    Buffer<Splat> splats;
    Buffer<Rect> pixel_rects;
    Buffer<std::uint32_t> tile_counts, depth_keys;
    Buffer<SplatGradientSum> gradients;  // zero between steps

    explicit Arrays(Memory& memory)
        : splats(memory), pixel_rects(memory), tile_counts(memory), depth_keys(memory),
          gradients(memory) {}
    void reserve(std::size_t count) {
      splats.resize_discard(count);
      pixel_rects.resize_discard(count);
      tile_counts.resize_discard(count);
      depth_keys.resize_discard(count);
      if (gradients.size() >= count) return;
      gradients.resize_discard(count);
      gradients.fill_zero();
    }
    void exchange(Workspace& workspace, RenderPass& pass) {
      splats.swap(pass.splats);
      pixel_rects.swap(pass.pixel_rects);
      tile_counts.swap(pass.tile_counts);
      depth_keys.swap(workspace.depth_keys);
      gradients.swap(workspace.splat_gradients);
    }
  };
  Memory& memory_;
  std::vector<Arrays> others_;
};

}  // namespace gs::cuda
