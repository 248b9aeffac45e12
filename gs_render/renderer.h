// SPDX-License-Identifier: Apache-2.0
// The renderer's contract.
#pragma once

#include <memory>

#include "gs_core/camera.h"
#include "gs_core/gaussians.h"
#include "gs_core/image.h"
#include "gs_render/render_pass.h"

namespace gs {

class Fusion;
struct FusionRule;

/// A model that is drawn many times and does not change in between, as a renderer likes to have it
/// (Renderer::pack). This base class is the Gaussians themselves.
class PackedScene {
 public:
  explicit PackedScene(const GaussiansSpan& gaussians) : gaussians_(gaussians) {}
  virtual ~PackedScene() = default;
  const GaussiansSpan& gaussians() const { return gaussians_; }

 private:
  GaussiansSpan gaussians_;
};

/// Renders Gaussians and pulls gradients back through the picture. A backend owns one.
class Renderer {
 public:
  virtual ~Renderer() = default;
  /// The memory of its passes.
  virtual Memory& memory() = 0;

  /// Renders and fills `pass`: picture, transmittance, and everything that backward() needs.
  virtual void forward(const GaussiansSpan& gaussians, const Camera& camera,
                       const RenderSettings& settings, RenderPass& pass) = 0;

  /// Prepares Gaussians for draw(): worth it from a few frames on. They must outlive the result,
  /// and must not change meanwhile. `settings` are those of the frames; where a frame has another
  /// SH degree, or where there was no memory for the packed copy, draw() reads the Gaussians
  /// themselves.
  virtual std::unique_ptr<PackedScene> pack(const GaussiansSpan& gaussians,
                                            const RenderSettings& settings);
  /// forward() of a packed model, for pictures without a backward pass. SH may be rounded,
  /// and so may be colors. Of the pass only the counts and lists of
  /// tiles, picture and transmittance are defined; `splats` may be empty.
  virtual void draw(const PackedScene& scene, const Camera& camera, const RenderSettings& settings,
                    RenderPass& pass);

  /// The picture of a pass in host memory, (height, width, 3): to_image8(image_of(pass)). A device
  /// rounds before it copies, so that a quarter of the bytes is copied; a value halfway between two
  /// may then be rounded to the other one.
  virtual Image8 picture_of(const RenderPass& pass);

  /// What makes a surface of this renderer's passes, on its device: fusion/fusion.h.
  virtual std::unique_ptr<Fusion> fusion(const FusionRule& rule);

  /// Pulls dL/d(picture) back to the parameters. `pass` is the result of forward() with the same
  /// arguments.
  ///
  /// gradients   N rows, written whole: zero where a Gaussian was not visible
  /// dL_dmean2d  (N) gradient by the image-plane mean, per pixel; zero where not visible. With
  ///             settings.absolute_gradient it sums the absolute values of the pixels' shares
  virtual void backward(const GaussiansSpan& gaussians, const Camera& camera,
                        const RenderSettings& settings, RenderPass& pass, const PictureGradient& dL,
                        const GaussiansSpan& gradients, Span<Vec2f> dL_dmean2d) = 0;
};

/// Throws UsageError where Gaussians cannot be drawn in the order by pixel: in space and time, or
/// through a lens.
void check_has_rays(const GaussiansSpan& gaussians, const Camera& camera);

/// The scalar renderer. It is the reference: every other renderer must compute the same.
std::unique_ptr<Renderer> make_scalar_renderer();

/// The pass's picture in host memory, (height, width, 3), multiplied by `exposure` and clamped to
/// [0, 1].
ImageF image_of(const RenderPass& pass, const Vec3f& exposure = Vec3f(1));
/// A picture from planes (3, height, width) in host memory.
ImageF image_of(Span<const float> planes, int width, int height, const Vec3f& exposure = Vec3f(1));

}  // namespace gs
