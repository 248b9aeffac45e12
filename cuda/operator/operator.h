// SPDX-License-Identifier: Apache-2.0
// Drawing and its gradient as an operator on arrays that somebody else owns: PyTorch, JAX and CuPy
// call it (docs/reference/differentiable.md). It keeps no state on the device. All memory comes from
// the caller, and all work is done on the caller's stream. gs_render/exact is its twin on the CPU.
//
// This header has no CUDA types, so that any compiler can include it.
#pragma once

#include <functional>
#include <memory>

#include "gs_core/camera.h"
#include "gs_render/render_pass.h"

namespace gs::cuda {

/// Rows of `Number`s in device memory.
template <class Number>
struct Rows {
  Number* data = nullptr;
  std::size_t stride = 0;  // numbers from one row to the next

#ifdef __CUDACC__
  __device__ Number* operator[](std::size_t i) const { return data + i * stride; }
#endif
};

/// One array for each parameter of N Gaussians. Of each pair or triple that is named with "or" the
/// others are null. As gradients, arrays that nobody wants are null.
template <class Number>
struct OperatorArrays {
  Rows<Number> means;        // (N, 3)  world units
  Rows<Number> rotations;    // (N, 4)  w x y z of any length, with scales; or covariances
  Rows<Number> scales;       // (N, 3)  standard deviations in world units, or their logs
  Rows<Number> covariances;  // (N, 6)  upper triangle, world units^2
  Rows<Number> opacities;    // (N)     0 to 1, or their logits
  Rows<Number> colors;       // (N, 3)  used as they are; or sh0
  Rows<Number> sh0;          // (N, 3)  coefficients, the color is at least 0
  Rows<Number> sh_rest;      // (N, sh_rest_count(degree in use) or more, 3)
  Rows<Number> screen;       // (N, 2)  pixels, added to the projected means; may be null
};

/// What is drawn, and from where.
struct OperatorInput {
  std::size_t count = 0;  // N
  OperatorArrays<const float> arrays;
  bool has_log_scales = false, has_logit_opacities = false;
  bool has_inverse_depth =
      false;      // the depth of a picture sums weights over depths, not times them
  Camera camera;  // its size counts in any case
  const float* viewmat = nullptr;  // (4, 4)  cam_from_world in place of the camera's
  const float* K = nullptr;        // (3, 3)  fx, fy, cx, cy in place of the camera's
};

/// Where a picture is written, in device memory; what is null is not wanted.
struct OperatorPicture {
  float* image = nullptr;  // (3, H, W)  with the background
  float* alpha = nullptr;  // (H, W)     1 - transmittance
  float* depth = nullptr;  // (H, W)     sum of weights times depths; needs settings.blends_depth
};

/// dL by a picture, in device memory.
struct OperatorPictureGradient {
  const float* image = nullptr;  // (3, H, W)
  const float* alpha = nullptr;  // (H, W)  null: zeros
  const float* depth = nullptr;  // (H, W)  null: zeros
};

/// Where gradients are written, in device memory; what is null is not computed. Rows of Gaussians
/// that are not visible become zero.
struct OperatorGradients {
  OperatorArrays<float> arrays;
  float* absolute_screen = nullptr;  // (N, 2)  by the projected means, absolute values of pixels
  float* viewmat = nullptr;          // (4, 4)  twelve free entries, the last row is zero
  float* K = nullptr;                // (3, 3)  four entries, the others are zero
};

/// Returns device memory of so many bytes, aligned to 256. What it throws ends the call.
using Allocate = std::function<void*(std::size_t bytes)>;

/// The stream of a call, and where its memory comes from. `kept` outlives the frame, `scratch` is
/// free once the call has returned: what comes later on the stream may overwrite it.
struct OperatorCall {
  int device = 0;
  void* stream = nullptr;  // cudaStream_t
  Allocate kept, scratch;
};

/// What is kept of a picture that was drawn, for its gradient. Nothing changes it, so that gradients
/// can be asked for again and again, also where the caller has changed the picture. All pointers are to device memory.
class OperatorFrame {
 public:
  virtual ~OperatorFrame() = default;
  virtual const float* transmittance() const = 0;        // (H, W)
  virtual const Splat* splats() const = 0;               // (N)  undefined where not visible
  virtual const float* depths() const = 0;               // (N)  likewise
  virtual const std::uint32_t* tile_counts() const = 0;  // (N)  tiles hit; 0: not visible
  virtual std::uint32_t instances() const = 0;           // of Gaussians in tiles
};

/// Draws Gaussians to `to`. Waits once, for the number of instances. Throws Error where the GPU fails.
/// settings.background_on_device may replace the background.
std::unique_ptr<OperatorFrame> draw(const OperatorCall& call, const OperatorInput& input,
                                    const RenderSettings& settings, const OperatorPicture& to);

/// Pulls a gradient back to everything that draw() has read, whose arguments it takes again. Does not
/// wait.
void pull_back(const OperatorCall& call, const OperatorFrame& frame, const OperatorInput& input,
               const RenderSettings& settings, const OperatorPictureGradient& dL,
               const OperatorGradients& gradients);

}  // namespace gs::cuda
