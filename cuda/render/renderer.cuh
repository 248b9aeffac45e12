// SPDX-License-Identifier: Apache-2.0
// The CUDA renderer runs the stages in order. Outside of training it reads back the number of
// instances, which waits.
#pragma once

#include "cuda/stages.cuh"

namespace gs::cuda {

/// Throws Error where a view has more instances than the sorts can count.
void check_can_be_sorted(std::uint64_t instances);

class CudaRenderer final : public Renderer {
 public:
  CudaRenderer(Context& context, Memory& memory);
  Memory& memory() override { return memory_; }
  void forward(const GaussiansSpan& gaussians, const Camera& camera, const RenderSettings& settings,
               RenderPass& pass) override;
  void backward(const GaussiansSpan& gaussians, const Camera& camera,
                const RenderSettings& settings, RenderPass& pass, Span<const float> dL_dimage,
                const GaussiansSpan& gradients, Span<Vec2f> dL_dmean2d) override;

  /// forward() for at most `capacity` instances, without waiting; see create_instances().
  void forward(const GaussiansSpan& gaussians, const Camera& camera, const RenderSettings& settings,
               RenderPass& pass, std::uint32_t capacity, StepReport* report, std::uint32_t step);
  /// Reserves dL/d(splat) of so many Gaussians. New entries are zero.
  void reserve_gradients(std::size_t count, const RenderSettings& settings);
  /// Sets the gradients back to zero after a step that failed.
  void clear_gradients();
  Workspace& workspace() { return workspace_; }
  /// Frees the workspace, except the flag that says whether steps are halted.
  void release_caches();

 private:
  std::uint32_t instance_count(const RenderPass& pass);

  Context& context_;
  Memory& memory_;
  Workspace workspace_;
};

}  // namespace gs::cuda
