// SPDX-License-Identifier: Apache-2.0
// The surface terms of a photo on the GPU: the gradient of their losses.
#pragma once

#include "cuda/device/context.cuh"
#include "gs_core/buffer.h"
#include "gs_core/math/loss/area_filter.h"
#include "gs_core/math/render/surface_loss.h"
#include "gs_render/render_pass.h"

namespace gs::cuda {

/// The surface losses of one photo after the other.
class SurfaceStage {
 public:
  explicit SurfaceStage(Memory& memory)
      : inverse_depth_(memory), gray_(memory), other_gray_(memory), surfaces_(memory),
        gradient_(memory) {}

  /// The photo that is compared, and its neighbor, in shades of gray. Each may be overwritten once
  /// this has returned.
  void take_photo(Context& context, const Camera& camera, const PhotoBytes& photo);
  void take_neighbor(Context& context, const Camera& camera, const PhotoBytes& photo);
  /// Twin of compare_surface() of the scalar backend, after take_photo() and, with `neighbor`, which
  /// may be null, after take_neighbor(). Returns dL/d(surface_image), valid until the next call.
  Span<const SurfaceRow> compare(Context& context, const Camera& camera, const NormalMap& prior,
                                 const Camera* neighbor, const SurfaceWeights& weights,
                                 int patch_phase, const RenderPass& pass);
  void release();

 private:
  Buffer<float> inverse_depth_, gray_, other_gray_;  // (H, W)
  Buffer<PixelSurface<float>> surfaces_;             // (H, W)  dL by them
  Buffer<SurfaceRow> gradient_;                      // (H, W)
};

}  // namespace gs::cuda
