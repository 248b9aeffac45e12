// SPDX-License-Identifier: Apache-2.0
// The photos of a step. What works on rows of the model, stages 1, 7 and 8, is done for all photos
// at once. Stages 2 to 6 draw one photo after another in between. The arrays of a photo that both
// ends need are therefore kept for each photo.
#pragma once

#include <vector>

#include "cuda/render/renderer.cuh"
#include "cuda/stages.cuh"

namespace gs::cuda {

/// The arrays of the photos that are drawn with one pass. Those of the first photo are the pass's
/// and the workspace's own.
class PhotoBuffers {
 public:
  explicit PhotoBuffers(Memory& memory) : memory_(memory) {}

  /// The arrays of photo `i` of those that the pass draws, before any of them is drawn. Gradients
  /// are zero.
  PhotoRows rows(std::size_t i, const Camera& camera, const RenderSettings& settings,
                 const DevicePose* pose, std::size_t count, CudaRenderer& renderer,
                 RenderPass& pass) {
    while (others_.size() < i) others_.emplace_back(memory_);
    Workspace& workspace = renderer.workspace();
    if (i > 0) exchange(others_[i - 1], workspace, pass);
    pass.begin(camera, count);
    workspace.depth_keys.resize_discard(count);
    renderer.reserve_gradients(count, settings);
    const PhotoRows rows(camera, settings, pose, workspace, pass);
    if (i > 0) exchange(others_[i - 1], workspace, pass);
    return rows;
  }
  /// Gives pass and workspace the arrays of photo `i`, which is drawn next; photos are drawn in
  /// order. Arrays stay where they are in memory.
  void select(std::size_t i, const PhotoRows& photo, std::size_t count, CudaRenderer& renderer,
              RenderPass& pass) {
    if (i > 0) exchange(others_[i - 1], renderer.workspace(), pass);
    pass.begin(photo.camera, count);
    pass.scratch<CudaScratch>().has_view_splats = false;
  }
  /// After a step that failed.
  void clear_gradients() {
    for (PhotoArrays& arrays : others_) {
      arrays.gradients.fill_zero();
      arrays.fragment_sums.fill_zero();
      arrays.fixed_fragment_sums.fill_zero();
    }
  }
  /// Between steps.
  void release() { others_.clear(); }

 private:
  static void exchange(PhotoArrays& arrays, Workspace& workspace, RenderPass& pass) {
    arrays.splats.swap(pass.splats);
    arrays.pixel_rects.swap(pass.pixel_rects);
    arrays.tile_counts.swap(pass.tile_counts);
    arrays.depth_keys.swap(workspace.depth_keys);
    arrays.gradients.swap(workspace.splat_gradients);
    arrays.fragment_sums.swap(workspace.fragment_sums);
    arrays.fixed_fragment_sums.swap(workspace.fixed_fragment_sums);
  }

  Memory& memory_;
  std::vector<PhotoArrays> others_;
};

}  // namespace gs::cuda
