// SPDX-License-Identifier: Apache-2.0
// Stages 4, 6 and 7 for surfaces, twin of gs_render/stages/blend_surface.cpp. The surface of a splat
// is a row of features, so that blending them and its gradient are those of operator/blend_features.cu.
#include "cuda/stages.cuh"

namespace gs::cuda {
namespace {

constexpr int kSurfaceThreads = 128;  // rows are independent

// The Gaussians of a pass.
struct SurfaceShapes {
  GaussiansSpan gaussians;
  Camera camera;
  SplatSettings settings;
  const std::uint32_t* tile_counts;

  __device__ GaussianShape<float> shape(std::size_t i) const {
    return {gaussians.mean[i], gaussians.log_scale[i], gaussians.rotation[i]};
  }
  __device__ float filter(std::size_t i) const {
    return gaussians.has_filter ? gaussians.filter_scale[i] : 0.0f;
  }
};

__global__ void __launch_bounds__(kSurfaceThreads)
    surface_rows_kernel(const __grid_constant__ SurfaceShapes from, Span<SurfaceRow> rows) {
  const std::size_t i = std::size_t(blockIdx.x) * kSurfaceThreads + threadIdx.x;
  if (i >= rows.size || from.tile_counts[i] == 0) return;
  rows[i] = surface_row(from.camera, from.shape(i), from.filter(i), from.settings);
}

__global__ void __launch_bounds__(kSurfaceThreads)
    surface_backward_kernel(const __grid_constant__ SurfaceShapes from, const SurfaceRow* dL,
                            float weight, bool is_first, Span<GaussianShape<float>> to) {
  const std::size_t i = std::size_t(blockIdx.x) * kSurfaceThreads + threadIdx.x;
  if (i >= to.size) return;
  GaussianShape<float> sum;
  if (!is_first) sum = to[i];
  if (from.tile_counts[i] > 0) {
    const GaussianShape<float> of_photo =
        surface_row_vjp(from.camera, from.shape(i), from.filter(i), from.settings, dL[i]);
    const Quatf& q = of_photo.rotation;
    sum.mean += weight * of_photo.mean;
    sum.log_scale += weight * of_photo.log_scale;
    sum.rotation = {sum.rotation.w + weight * q.w, sum.rotation.x + weight * q.x,
                    sum.rotation.y + weight * q.y, sum.rotation.z + weight * q.z};
  } else if (!is_first) {
    return;
  }
  to[i] = sum;
}

OperatorInput rows_as_features(const RenderPass& pass) {
  OperatorInput input;
  input.count = pass.surface_rows.size();
  input.features = reinterpret_cast<const float*>(pass.surface_rows.data());
  input.channels = kSurfaceNumbers;
  return input;
}

}  // namespace

void blend_surface(Context& context, const GaussiansSpan& gaussians, const Camera& camera,
                   const RenderSettings& settings, RenderPass& pass) {
  const StageScope scope(context, "blend surface");
  GS_CHECK(!gaussians.has_time && !camera.has_lens() && !is_by_pixel(pass));
  const std::size_t count = gaussians.mean.size;
  pass.surface_rows.resize_discard(count);
  pass.surface_image.resize_discard(pass.pixel_count());
  context.launch("surface rows", surface_rows_kernel, blocks_for(count, kSurfaceThreads),
                 kSurfaceThreads,
                 SurfaceShapes{gaussians, camera, settings, pass.tile_counts.data()},
                 pass.surface_rows.span());
  blend_features(context, settings, pass, rows_as_features(pass),
                 reinterpret_cast<float*>(pass.surface_image.data()));
}

void surface_backward(Context& context, const GaussiansSpan& gaussians, const Camera& camera,
                      const RenderSettings& settings, Span<const SurfaceRow> dL, float weight,
                      bool is_first, const std::uint32_t* halted, Workspace& workspace,
                      const RenderPass& pass) {
  const StageScope scope(context, "blend surface backward");
  GS_CHECK(dL.size == pass.pixel_count() && pass.surface_image.size() == dL.size);
  const std::size_t count = gaussians.mean.size;
  workspace.surface_gradients.resize_discard(count);
  workspace.shape_gradients.resize_discard(count);
  check(cudaMemsetAsync(workspace.surface_gradients.data(), 0,
                        workspace.surface_gradients.size_bytes(), context.stream()),
        "gradient by surfaces");
  OperatorPictureGradient by_picture;
  by_picture.features = reinterpret_cast<const float*>(dL.data);
  by_picture.drawn_features = reinterpret_cast<const float*>(pass.surface_image.data());
  RenderSettings of_surface = settings;
  of_surface.absolute_gradient = false;  // density control looks at colors
  blend_features_backward(context, of_surface, pass, rows_as_features(pass), by_picture, halted,
                          workspace, reinterpret_cast<float*>(workspace.surface_gradients.data()));
  context.launch(
      "surface backward", surface_backward_kernel, blocks_for(count, kSurfaceThreads),
      kSurfaceThreads, SurfaceShapes{gaussians, camera, settings, pass.tile_counts.data()},
      workspace.surface_gradients.data(), weight, is_first, workspace.shape_gradients.span());
}

}  // namespace gs::cuda
