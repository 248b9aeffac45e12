// SPDX-License-Identifier: Apache-2.0
#include "cuda/render/renderer.cuh"

#include <algorithm>
#include <limits>

#include "cuda/render/packed_scene.cuh"
#include "gs_render/fusion/fusion.h"

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
    : context_(context), memory_(memory), workspace_(memory), picture_words_(memory) {
  workspace_.halted.resize(1);
  workspace_.halted.fill_zero();
}

void CudaRenderer::finish_projected(const RenderSettings& settings, RenderPass& pass,
                                    std::uint32_t capacity, StepReport* report,
                                    std::uint32_t step) {
  pass.background = settings.background;
  finish(settings, pass, {capacity, workspace_.halted.data(), report, step});
}

void CudaRenderer::finish_counted(const RenderSettings& settings, RenderPass& pass,
                                  StepReport* report, std::uint32_t step) {
  pass.background = settings.background;
  order_by_depth(context_, settings, workspace_, pass, pass.tile_counts.size());
  const std::uint32_t instances = count_instances(settings, pass);
  sort_and_blend(settings, pass, {std::max(instances, 1u), workspace_.halted.data(), report, step});
}

void CudaRenderer::forward(const GaussiansSpan& gaussians, const Camera& camera,
                           const RenderSettings& given, RenderPass& pass) {
  RenderSettings settings = given;
  if (settings.blends_surface) settings.for_backward = true;  // needs each pixel's last fragment
  draw_frame(gaussians.mean.size, camera, settings, pass, [&] {
    preprocess(context_, gaussians, camera, settings, workspace_, pass);
    if (settings.order == RenderOrder::pixel)
      find_ray_depths(context_, gaussians, camera, nullptr, pass);
  });
  if (settings.blends_surface) blend_surface(context_, gaussians, camera, settings, pass);
}

std::unique_ptr<PackedScene> CudaRenderer::pack(const GaussiansSpan& gaussians,
                                                const RenderSettings& settings) {
  if (gaussians.has_time || !blends_on_tensor_cores(context_, settings))
    return Renderer::pack(gaussians, settings);
  try {
    return std::make_unique<CudaPackedScene>(context_, memory_, gaussians, settings);
  } catch (const Error& error) {
    if (error.code() != ExitCode::out_of_memory) throw;
    return Renderer::pack(gaussians, settings);  // slower, and needs nothing more
  }
}

void CudaRenderer::draw(const PackedScene& scene, const Camera& camera,
                        const RenderSettings& settings, RenderPass& pass) {
  const auto* const packed = dynamic_cast<const CudaPackedScene*>(&scene);
  if (!packed || camera.has_lens() || !packed->serves(context_, settings))
    return forward(scene.gaussians(), camera, settings, pass);
  draw_frame(packed->count(), camera, settings, pass,
             [&] { preprocess(context_, *packed, camera, settings, workspace_, pass); });
}

template <class Project>
void CudaRenderer::draw_frame(std::size_t gaussians, const Camera& camera,
                              const RenderSettings& settings, RenderPass& pass,
                              const Project& project) {
  pass.background = settings.background;
  const FrameKind kind{camera.width, camera.height, gaussians};
  const std::uint32_t capacity = settings.for_backward ? 0 : forecast_.capacity_for(kind);
  if (capacity > 0 && draw_within(capacity, kind, settings, pass, project)) return;
  project();
  order_by_depth(context_, settings, workspace_, pass, gaussians);
  const std::uint32_t instances = count_instances(settings, pass);
  forecast_.note(kind, instances);
  sort_and_blend(settings, pass, {std::max(instances, 1u)});
}

template <class Project>
bool CudaRenderer::draw_within(std::uint32_t capacity, const FrameKind& kind,
                               const RenderSettings& settings, RenderPass& pass,
                               const Project& project) {
  const std::uint32_t frame = ++last_frame_;
  project();
  finish(settings, pass, {capacity, nullptr, reports_.of_step(frame), frame});
  // The host is here long before the device, which is not kept waiting.
  const std::uint32_t instances = reports_.wait(context_, frame).instances;
  if (instances > capacity) return false;  // of which order_by_depth() may have left some out
  forecast_.note(kind, instances);
  return true;
}

Image8 CudaRenderer::picture_of(const RenderPass& pass) {
  Image8 picture(pass.width, pass.height, 3);
  pack_picture(context_, pass, picture_words_);
  memory_.download(picture.pixels.data(), picture_words_.data(), picture.pixels.size());
  return picture;
}

std::unique_ptr<Fusion> CudaRenderer::fusion(const FusionRule& rule) {
  return make_fusion(context_, memory_, rule);
}

void CudaRenderer::finish(const RenderSettings& settings, RenderPass& pass,
                          const InstanceLimit& limit) {
  // Each visible Gaussian has an instance. One row more shows that there are too many.
  order_by_depth(context_, settings, workspace_, pass, std::size_t(limit.capacity) + 1);
  sort_and_blend(settings, pass, limit);
}

void CudaRenderer::sort_and_blend(const RenderSettings& settings, RenderPass& pass,
                                  const InstanceLimit& limit) {
  create_instances(context_, settings, workspace_, pass, limit);
  if (is_by_pixel(pass)) add_depths_to_keys(context_, settings, workspace_, pass, limit.capacity);
  sort_by_tile(context_, settings, workspace_, pass, limit.capacity);
  blend(context_, settings, pass);
}

// Waits for the device.
std::uint32_t CudaRenderer::count_instances(const RenderSettings& settings,
                                            const RenderPass& pass) {
  if (pass.tile_counts.empty()) return 0;
  const std::uint32_t frame = ++last_frame_;
  report_instances(context_, settings, workspace_, pass, reports_.of_step(frame), frame);
  const std::uint32_t instances = reports_.wait(context_, frame).instances;
  check_can_be_sorted(instances);
  return instances;
}

void CudaRenderer::release_caches() {
  Workspace fresh(memory_);
  fresh.halted.swap(workspace_.halted);
  workspace_ = std::move(fresh);
  picture_words_ = Buffer<std::uint32_t>(memory_);
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
    else if (!sums_among_gradients(settings))
      reserve(workspace_.fragment_sums);
  }
  if (!settings.deterministic) return;
  reserve(workspace_.fine_sums);
  reserve(workspace_.coarse_sums);
}

void CudaRenderer::backward(const GaussiansSpan& gaussians, const Camera& camera,
                            const RenderSettings& settings, RenderPass& pass,
                            const PictureGradient& dL, const GaussiansSpan& gradients,
                            Span<Vec2f> dL_dmean2d) {
  RenderSettings plain = settings;
  plain.fragment_statistic = FragmentStatistic::none;  // steps alone gather them: backend.cu
  reserve_gradients(gaussians.mean.size, plain);
  blend_backward(context_, plain, dL, workspace_, pass);
  if (!dL.surface.empty())
    surface_backward(context_, gaussians, camera, plain, dL.surface, 1, true, nullptr, workspace_,
                     pass);
  preprocess_backward(context_, gaussians, {camera, settings, nullptr, workspace_, pass}, gradients,
                      dL_dmean2d, dL.surface.empty() ? nullptr : workspace_.shape_gradients.data());
}

}  // namespace gs::cuda
