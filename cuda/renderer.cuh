// SPDX-License-Identifier: Apache-2.0
// The CUDA renderer: the stages in order. Outside of training it asks for the number of instances, and waits for it.
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

  /// forward() with room for so many instances and no more, without waiting; see create_instances().
  void forward(const GaussiansSpan& gaussians, const Camera& camera, const RenderSettings& settings,
               RenderPass& pass, std::uint32_t capacity, StepReport* report, std::uint32_t step);
  /// Room for dL/d(splat) of so many Gaussians, zero where it is new.
  void reserve_gradients(std::size_t count, const RenderSettings& settings);
  /// Back to zero, after a step that broke off.
  void clear_gradients();
  WorkingRoom& room() { return room_; }
  /// Gives back all working room but what says whether steps are halted.
  void release_caches();

 private:
  std::uint32_t instance_count(const RenderPass& pass);

  Context& context_;
  Memory& memory_;
  WorkingRoom room_;
};

}  // namespace gs::cuda
