// SPDX-License-Identifier: Apache-2.0
#include "cuda/render/renderer.cuh"

#include <algorithm>
#include <limits>

namespace gs::cuda {
namespace {

// CUB counts in int
constexpr std::uint32_t kMostInstances = std::numeric_limits<std::int32_t>::max();

}  // namespace

void check_can_be_sorted(std::uint64_t instances) {
  if (instances > kMostInstances)
    throw Error(
        "a view has more than 2^31 splats in tiles; lower the resolution (-r) or the number of "
        "Gaussians (--max-gaussians)",
        ExitCode::out_of_memory);
}

CudaRenderer::CudaRenderer(Context& context, Memory& memory)
    : context_(context), memory_(memory), workspace_(memory) {
  workspace_.halted.resize(1);
  workspace_.halted.fill_zero();
}

void CudaRenderer::forward(const GaussiansSpan& gaussians, const Camera& camera,
                           const RenderSettings& settings, RenderPass& pass, std::uint32_t capacity,
                           StepReport* report, std::uint32_t step) {
  pass.background = settings.background;
  preprocess(context_, gaussians, camera, settings, workspace_, pass);
  // Each visible Gaussian has an instance. One row more shows that there are too many.
  order_by_depth(context_, workspace_, pass, std::size_t(capacity) + 1);
  create_instances(context_, settings, workspace_, pass, capacity, report, step);
  sort_by_tile(context_, workspace_, pass, capacity);
  blend(context_, settings, pass);
}

void CudaRenderer::forward(const GaussiansSpan& gaussians, const Camera& camera,
                           const RenderSettings& settings, RenderPass& pass) {
  pass.background = settings.background;
  preprocess(context_, gaussians, camera, settings, workspace_, pass);
  order_by_depth(context_, workspace_, pass, gaussians.mean.size);
  const std::uint32_t capacity = std::max(instance_count(pass), 1u);
  create_instances(context_, settings, workspace_, pass, capacity, nullptr, 0);
  sort_by_tile(context_, workspace_, pass, capacity);
  blend(context_, settings, pass);
}

// Waits for the device.
std::uint32_t CudaRenderer::instance_count(const RenderPass& pass) {
  if (pass.tile_counts.empty()) return 0;
  const std::size_t last = pass.depth_order.size() - 1;
  std::uint32_t gaussian = 0, first = 0, count = 0;
  memory_.download(&gaussian, pass.depth_order.data() + last, sizeof gaussian);
  memory_.download(&first, workspace_.first_of_order.data() + last, sizeof first);
  memory_.download(&count, pass.tile_counts.data() + gaussian, sizeof count);
  check_can_be_sorted(std::uint64_t(first) + count);
  return first + count;
}

void CudaRenderer::release_caches() {
  Workspace fresh(memory_);
  fresh.halted.swap(workspace_.halted);
  workspace_ = std::move(fresh);
}

void CudaRenderer::clear_gradients() {
  workspace_.splat_gradients.fill_zero();
  workspace_.fine_sums.fill_zero();
  workspace_.coarse_sums.fill_zero();
  workspace_.fragment_sums.fill_zero();
  workspace_.fixed_fragment_sums.fill_zero();
}

void CudaRenderer::reserve_gradients(std::size_t count, const RenderSettings& settings) {
  const auto reserve = [count](auto& sums) {
    if (sums.size() >= count) return;
    sums.resize_discard(count);
    sums.fill_zero();
  };
  reserve(workspace_.splat_gradients);
  if (settings.fragment_statistic != FragmentStatistic::none) {
    if (settings.deterministic)
      reserve(workspace_.fixed_fragment_sums);
    else
      reserve(workspace_.fragment_sums);
  }
  if (!settings.deterministic) return;
  reserve(workspace_.fine_sums);
  reserve(workspace_.coarse_sums);
}

void CudaRenderer::backward(const GaussiansSpan& gaussians, const Camera& camera,
                            const RenderSettings& settings, RenderPass& pass,
                            Span<const float> dL_dimage, const GaussiansSpan& gradients,
                            Span<Vec2f> dL_dmean2d) {
  RenderSettings plain = settings;
  plain.fragment_statistic = FragmentStatistic::none;  // steps alone gather them: backend.cu
  reserve_gradients(gaussians.mean.size, plain);
  blend_backward(context_, plain, dL_dimage, workspace_, pass);
  preprocess_backward(context_, gaussians, camera, settings, workspace_, pass, gradients,
                      dL_dmean2d);
}

}  // namespace gs::cuda
