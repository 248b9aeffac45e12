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
    if (i > 0) others_[i - 1].exchange(workspace, pass);
    pass.begin(camera, count, true, settings.with_depths);
    workspace.depth_keys.resize_discard(count);
    renderer.reserve_gradients(count, settings);
    const PhotoRows rows(camera, settings, pose, workspace, pass);
    if (i > 0) others_[i - 1].exchange(workspace, pass);
    return rows;
  }
  /// Gives pass and workspace the arrays of photo `i`, which is drawn next; photos are drawn in
  /// order. Arrays stay where they are in memory.
  void select(std::size_t i, const PhotoRows& photo, std::size_t count, CudaRenderer& renderer,
              RenderPass& pass) {
    if (i > 0) others_[i - 1].exchange(renderer.workspace(), pass);
    pass.begin(photo.camera, count, true, photo.settings.with_depths);
    pass.scratch<CudaScratch>().has_view_splats = false;
  }
  /// After a step that failed.
  void clear_gradients() {
    for (Arrays& arrays : others_) {
      arrays.gradients.fill_zero();
      arrays.fragment_sums.fill_zero();
      arrays.fixed_fragment_sums.fill_zero();
    }
  }
  /// Between steps.
  void release() { others_.clear(); }

 private:
  struct Arrays {
    Buffer<Splat> splats;
    Buffer<float> depths;
    Buffer<Rect> pixel_rects;
    Buffer<std::uint32_t> tile_counts, depth_keys;
    // zero between steps
    Buffer<SplatGradientSum> gradients;
    Buffer<Vec4f> fragment_sums;
    Buffer<FixedFragmentSums> fixed_fragment_sums;

    explicit Arrays(Memory& memory)
        : splats(memory), depths(memory), pixel_rects(memory), tile_counts(memory),
          depth_keys(memory), gradients(memory), fragment_sums(memory),
          fixed_fragment_sums(memory) {}
    void exchange(Workspace& workspace, RenderPass& pass) {
      splats.swap(pass.splats);
      depths.swap(pass.depths);
      pixel_rects.swap(pass.pixel_rects);
      tile_counts.swap(pass.tile_counts);
      depth_keys.swap(workspace.depth_keys);
      gradients.swap(workspace.splat_gradients);
      fragment_sums.swap(workspace.fragment_sums);
      fixed_fragment_sums.swap(workspace.fixed_fragment_sums);
    }
  };
  Memory& memory_;
  std::vector<Arrays> others_;
};

}  // namespace gs::cuda
