// SPDX-License-Identifier: Apache-2.0
// The renderer's contract.
#pragma once

#include <memory>

#include "gs_core/camera.h"
#include "gs_core/gaussians.h"
#include "gs_core/image.h"
#include "gs_render/render_pass.h"

namespace gs {

/// Renders Gaussians and pulls gradients back through the picture. A backend owns one.
class Renderer {
 public:
  virtual ~Renderer() = default;
  /// The memory of its passes.
  virtual Memory& memory() = 0;

  /// Renders and fills `pass`: picture, transmittance, and everything that backward() needs.
  virtual void forward(const GaussiansSpan& gaussians, const Camera& camera,
                       const RenderSettings& settings, RenderPass& pass) = 0;

  /// Pulls dL/d(image) back to the parameters. `pass` is the result of forward() with the same
  /// arguments.
  ///
  /// dL_dimage   (3, H, W)
  /// gradients   N rows, written whole: zero where a Gaussian was not visible
  /// dL_dmean2d  (N) gradient by the image-plane mean, per pixel; zero where not visible. With
  ///             settings.absolute_gradient it sums the absolute values of the pixels' shares
  virtual void backward(const GaussiansSpan& gaussians, const Camera& camera,
                        const RenderSettings& settings, RenderPass& pass,
                        Span<const float> dL_dimage, const GaussiansSpan& gradients,
                        Span<Vec2f> dL_dmean2d) = 0;
};

/// The scalar renderer. It is the reference: every other renderer must compute the same.
std::unique_ptr<Renderer> make_scalar_renderer();

/// The pass's picture in host memory, (height, width, 3), multiplied by `exposure` and clamped to
/// [0, 1].
ImageF image_of(const RenderPass& pass, const Vec3f& exposure = Vec3f(1));

}  // namespace gs
