// SPDX-License-Identifier: Apache-2.0
// The CUDA renderer runs the stages in order. Buffers and sorts need the number of instances, which
// only the device knows. Training has a forecast for each view (backend.cu). A frame without a
// backward pass has a forecast from the frames before it (frame_forecast.h): all of it is launched
// at once, and if there turn out to be more instances, it is drawn again. Every other frame waits
// for the number.
#pragma once

#include "cuda/render/reports.cuh"
#include "gs_render/frame_forecast.h"

namespace gs::cuda {

class CudaPackedScene;

/// Throws Error where a view has more instances than the sorts can count.
void check_can_be_sorted(std::uint64_t instances);

class CudaRenderer final : public Renderer {
 public:
  CudaRenderer(Context& context, Memory& memory);
  Memory& memory() override { return memory_; }
  void forward(const GaussiansSpan& gaussians, const Camera& camera, const RenderSettings& settings,
               RenderPass& pass) override;
  std::unique_ptr<PackedScene> pack(const GaussiansSpan& gaussians,
                                    const RenderSettings& settings) override;
  void draw(const PackedScene& scene, const Camera& camera, const RenderSettings& settings,
            RenderPass& pass) override;
  Image8 picture_of(const RenderPass& pass) override;
  std::unique_ptr<Fusion> fusion(const FusionRule& rule) override;
  void backward(const GaussiansSpan& gaussians, const Camera& camera,
                const RenderSettings& settings, RenderPass& pass, const PictureGradient& dL,
                const GaussiansSpan& gradients, Span<Vec2f> dL_dmean2d) override;

  /// forward() after stage 1, whose results are in the workspace and the pass, for at most
  /// `capacity` instances, without waiting; see create_instances().
  void finish_projected(const RenderSettings& settings, RenderPass& pass, std::uint32_t capacity,
                        StepReport* report, std::uint32_t step);
  /// Finishes a pass with as many instances as there are. Waits for the device.
  void finish_counted(const RenderSettings& settings, RenderPass& pass, StepReport* report,
                      std::uint32_t step);
  /// Reserves dL/d(splat) of so many Gaussians. New entries are zero.
  void reserve_gradients(std::size_t count, const RenderSettings& settings);
  /// Sets the gradients back to zero after a step that failed.
  void clear_gradients();
  Workspace& workspace() { return workspace_; }
  /// Frees the workspace, except the flag that says whether steps are halted.
  void release_caches();

 private:
  // A frame whose stage 1 is project().
  template <class Project>
  void draw_frame(std::size_t gaussians, const Camera& camera, const RenderSettings& settings,
                  RenderPass& pass, const Project& project);
  // Finishes a pass of at most so many instances; false if there are more, and then the pass is
  // undefined.
  template <class Project>
  bool draw_within(std::uint32_t capacity, const FrameKind& kind, const RenderSettings& settings,
                   RenderPass& pass, const Project& project);
  void finish(const RenderSettings& settings, RenderPass& pass, const InstanceLimit& limit);
  void sort_and_blend(const RenderSettings& settings, RenderPass& pass, const InstanceLimit& limit);
  std::uint32_t count_instances(const RenderSettings& settings, const RenderPass& pass);

  Context& context_;
  Memory& memory_;
  Workspace workspace_;
  Buffer<std::uint32_t> picture_words_;  // of 8 bits a channel, for picture_of()
  FrameForecast forecast_;
  Reports reports_{1};  // of the frame that is being drawn
  std::uint32_t last_frame_ = 0;
};

}  // namespace gs::cuda
