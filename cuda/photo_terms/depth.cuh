// SPDX-License-Identifier: Apache-2.0
// Photos with a depth map on the GPU: the maps, and the stage that adds the gradient of the depth
// loss.
#pragma once

#include <unordered_map>

#include "cuda/device/context.cuh"
#include "gs_core/buffer.h"
#include "gs_core/math/loss/depth_loss.h"
#include "gs_core/scene.h"
#include "gs_render/render_pass.h"

namespace gs::cuda {

struct Workspace;

/// A photo's depth map as its step sees it.
struct DepthMapOnDevice {
  const float* values = nullptr;       // (height, width) of the whole photo
  const std::uint8_t* mask = nullptr;  // of the reduced photo; null: every pixel trains
  int width = 0;                       // of the whole photo, in pixels
  int reduction = 1;
  DepthKind kind = DepthKind::metric;
};

/// The depth maps of the views that steps have used so far. A map is uploaded when its view is
/// first trained on, which waits for the device, and stays: 4 bytes a pixel of all photos together.
class DepthMaps {
 public:
  explicit DepthMaps(Memory& memory) : memory_(memory) {}
  struct Map {
    Buffer<float> values;  // (height, width)
    DepthKind kind;
  };
  /// That of a view that has one. Throws Error where memory runs out.
  const Map& of(const View& view);
  void forget() { maps_.clear(); }

 private:
  Memory& memory_;
  std::unordered_map<const View*, Map> maps_;
};

/// What the stage needs besides the workspace; reused from step to step.
class DepthStage {
 public:
  explicit DepthStage(Memory& memory)
      : colors_(memory), color_gradients_(memory), planes_(memory), dL_dplanes_(memory),
        sums_(memory), target_(memory) {}

  /// Twin of blend_depth(), compare_depth(), blend_depth_backward() and add_depth_gradients() of
  /// the scalar backend. It comes after blend_backward() of the colors and adds to what that has
  /// left in workspace.splat_gradients. The picture, transmittance and checkpoints of the pass are
  /// those of the depth afterwards.
  void add_gradient(Context& context, const RenderSettings& settings, const DepthMapOnDevice& map,
                    float weight, Workspace& workspace, RenderPass& pass);
  void release();

 private:
  Buffer<Vec3f> colors_, color_gradients_;  // (N) of the splats, while they have depths for colors
  Buffer<float> planes_, dL_dplanes_;       // (3, H, W)
  Buffer<DepthSums> sums_;                  // (blocks)
  Buffer<DepthTarget> target_;              // (1)
};

}  // namespace gs::cuda
