// SPDX-License-Identifier: Apache-2.0
// Photos with a depth map on the GPU: the gradient of the depth loss.
#pragma once

#include "cuda/device/context.cuh"
#include "gs_core/buffer.h"
#include "gs_core/math/loss/depth_loss.h"
#include "gs_render/render_pass.h"

namespace gs::cuda {

/// A photo's depth map as its step sees it.
struct DepthMapOnDevice {
  const float* values = nullptr;       // (height, width) of the whole photo
  const std::uint8_t* mask = nullptr;  // of the reduced photo; null: every pixel trains
  int width = 0;                       // of the whole photo, in pixels
  int reduction = 1;
  DepthKind kind = DepthKind::metric;
};

/// The depth loss of one photo after the other.
class DepthStage {
 public:
  explicit DepthStage(Memory& memory)
      : dL_ddepth_(memory), dL_dalpha_(memory), sums_(memory), target_(memory) {}

  /// Twin of compare_depth() of the scalar backend. Returns dL_dimage, with the gradients by the
  /// depth_image and by alpha beside it.
  PictureGradient compare(Context& context, const DepthMapOnDevice& map, float weight,
                          Span<const float> dL_dimage, const RenderPass& pass);
  void release();

 private:
  Buffer<float> dL_ddepth_, dL_dalpha_;  // (H, W)
  Buffer<DepthSums> sums_;               // (blocks)
  Buffer<DepthTarget> target_;           // (1)
};

}  // namespace gs::cuda
