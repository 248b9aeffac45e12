// SPDX-License-Identifier: Apache-2.0
// The scalar renderer: the stages in order.
#include "gs_core/error.h"
#include "gs_core/threads/parallel.h"
#include "gs_render/renderer.h"
#include "gs_render/stages.h"

namespace gs {
namespace {

constexpr std::size_t kPixelsPerChunk = 16384;

class ScalarRenderer final : public Renderer {
 public:
  Memory& memory() override { return host_memory(); }

  void forward(const GaussiansSpan& gaussians, const Camera& camera, const RenderSettings& settings,
               RenderPass& pass) override {
    pass.background = settings.background;
    preprocess(gaussians, camera, settings, pass);
    create_instances(settings, pass);
    sort_by_tile(pass);
    blend(settings, pass);
    blend_surface(gaussians, camera, settings, pass);
  }

  void backward(const GaussiansSpan& gaussians, const Camera& camera,
                const RenderSettings& settings, RenderPass& pass, const PictureGradient& dL,
                const GaussiansSpan& gradients, Span<Vec2f> dL_dmean2d) override {
    GS_CHECK(dL.image.size == 3 * pass.pixel_count());
    GS_CHECK(dL.alpha.empty() || dL.alpha.size == pass.pixel_count());
    GS_CHECK(dL.depth.empty() || dL.depth.size == pass.depth_image.size());
    GS_CHECK(dL.surface.empty() || dL.surface.size == pass.surface_image.size());
    blend_backward(settings, dL, pass);
    if (!dL.surface.empty()) blend_surface_backward(settings, dL.surface, pass);
    preprocess_backward(gaussians, camera, settings, pass, gradients, dL_dmean2d);
    if (!dL.surface.empty()) surface_backward(gaussians, camera, settings, pass, gradients);
  }
};

}  // namespace

void check_has_rays(const GaussiansSpan& gaussians, const Camera& camera) {
  if (gaussians.has_time) throw UsageError("a model that moves is drawn with render.order = \"z\"");
  if (camera.has_lens())
    throw UsageError(
        "cameras with a lens are drawn with render.order = \"z\"; photos have none with "
        "dataset.lens = \"undistort\" and dataset.rolling_shutter = false");
}

std::unique_ptr<PackedScene> Renderer::pack(const GaussiansSpan& gaussians, const RenderSettings&) {
  return std::make_unique<PackedScene>(gaussians);
}

void Renderer::draw(const PackedScene& scene, const Camera& camera, const RenderSettings& settings,
                    RenderPass& pass) {
  forward(scene.gaussians(), camera, settings, pass);
}

Image8 Renderer::picture_of(const RenderPass& pass) { return to_image8(image_of(pass)); }

std::unique_ptr<Renderer> make_scalar_renderer() { return std::make_unique<ScalarRenderer>(); }

ImageF image_of(const RenderPass& pass, const Vec3f& exposure) {
  const std::vector<float> planes = pass.image.download();
  return image_of({planes.data(), planes.size()}, pass.width, pass.height, exposure);
}

ImageF image_of(Span<const float> planes, int width, int height, const Vec3f& exposure) {
  const std::size_t plane = std::size_t(width) * std::size_t(height);
  GS_CHECK(planes.size == 3 * plane);
  ImageF image(width, height, 3);
  parallel_for(plane, kPixelsPerChunk, [&](std::size_t i) {
    for (int c = 0; c < 3; ++c)
      image.pixels[3 * i + c] = clamp_to(exposure[c] * planes[c * plane + i], 0.0f, 1.0f);
  });
  return image;
}

}  // namespace gs
