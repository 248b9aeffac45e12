// SPDX-License-Identifier: Apache-2.0
// The contract of drawing and its gradient as an operator on arrays in device memory that somebody
// else owns, such as PyTorch (docs/guide/differentiable.md). It keeps no state on the device. All
// memory comes from the caller, and all work is done on the caller's stream. cuda/operator fulfills
// it; gs_render/exact is its twin on the CPU.
#pragma once

#include <functional>
#include <memory>

#include "gs_core/camera.h"
#include "gs_render/footprint.h"
#include "gs_render/render_pass.h"

namespace gs {

/// Rows of `Number`s in device memory.
template <class Number>
struct OperatorRows {
  Number* data = nullptr;
  std::size_t stride = 0;  // numbers from one row to the next

  GS_HD Number* operator[](std::size_t i) const { return data + i * stride; }
};

/// One array for each parameter of N Gaussians. Of each pair or triple that is named with "or" the
/// others are null. As gradients, arrays that nobody wants are null.
template <class Number>
struct OperatorArrays {
  OperatorRows<Number> means;        // (N, 3)  world units
  OperatorRows<Number> rotations;    // (N, 4)  w x y z of any length, with scales; or covariances
  OperatorRows<Number> scales;       // (N, 3)  standard deviations in world units, or their logs
  OperatorRows<Number> covariances;  // (N, 6)  upper triangle, world units^2
  OperatorRows<Number> opacities;    // (N)     0 to 1, or their logits
  OperatorRows<Number> colors;       // (N, 3)  used as they are; or sh0
  OperatorRows<Number> sh0;          // (N, 3)  coefficients, the color is at least 0
  OperatorRows<Number> sh_rest;      // (N, sh_rest_count(degree in use) or more, 3)
  OperatorRows<Number> screen;       // (N, 2)  pixels, added to the projected means; may be null
};

/// What is drawn, and from where.
struct OperatorInput {
  std::size_t count = 0;  // N
  OperatorArrays<const float> arrays;
  bool has_log_scales = false, has_logit_opacities = false;
  const float* features = nullptr;  // (N, channels)  blended as they are; may be null
  int channels = 0;                 // a multiple of four
  // Room for so many instances, so that nothing waits for their number; 0: they are counted.
  std::uint32_t room = 0;
  // A picture's depth sums weights over depths, and not times depths.
  bool has_inverse_depth = false;
  Camera camera;                   // its size counts in any case
  const float* viewmat = nullptr;  // (4, 4)  cam_from_world in place of the camera's
  const float* K = nullptr;        // (3, 3)  fx, fy, cx, cy in place of the camera's
};

/// Where a picture is written, in device memory; what is null is not wanted.
struct OperatorPicture {
  float* image = nullptr;     // (3, H, W)  with the background
  float* alpha = nullptr;     // (H, W)     1 - transmittance
  float* depth = nullptr;     // (H, W)     sum of weights times depths; needs settings.blends_depth
  float* features = nullptr;  // (H, W, channels)  sum of weights times features
  // (N, kRowNumbers)  of each Gaussian: 1 where it is visible, half the longer axis of its ellipse,
  // rounded up, mean2d, both in pixels, depth, conic; zeros where it is not visible
  float* rows = nullptr;
  // (1)  not 0 where there were more instances than room: the picture lacks some, and gradients are
  // zero; needs a room
  std::uint32_t* overflowed = nullptr;
};
inline constexpr int kRowNumbers = 8;

/// dL by a picture, in device memory.
struct OperatorPictureGradient {
  const float* image = nullptr;  // (3, H, W)
  const float* alpha = nullptr;  // (H, W)  null: zeros
  const float* depth = nullptr;  // (H, W)  null: zeros
  // (H, W, channels)  null: zeros. Beside it, the features that were drawn.
  const float *features = nullptr, *drawn_features = nullptr;
};

/// Where gradients are written, in device memory; what is null is not computed. Rows of Gaussians
/// that are not visible become zero.
struct OperatorGradients {
  OperatorArrays<float> arrays;
  float* absolute_screen = nullptr;  // (N, 2)  by the projected means, absolute values of pixels
  float* viewmat = nullptr;          // (4, 4)  twelve free entries, the last row is zero
  float* K = nullptr;                // (3, 3)  four entries, the others are zero
  float* features = nullptr;         // (N, channels)
};

/// Where footprints are written, in device memory; what is null is not wanted. Gaussians that are not
/// visible have zeros.
struct OperatorFootprints {
  float* means2d = nullptr;        // (N, 2)  pixels
  float* depths = nullptr;         // (N)     world units
  float* conics = nullptr;         // (N, 3)  1 / pixels^2
  float* compensations = nullptr;  // (N)     of antialiasing
  int* radii = nullptr;            // (N, 2)  pixels
};

/// L = l1 mean|X - Y| + ssim mean SSIM(X, Y) of pictures X and Y in device memory (Wang et al. 2004).
struct OperatorComparison {
  const float *image, *reference;  // X, Y  (planes, H, W)  0 to 1
  int planes, height, width;
  int margin;  // pixels at each border in which SSIM does not count; zeros lie around the pictures
  float l1, ssim;
};

/// Returns device memory of so many bytes, aligned to 256. What it throws ends the call.
using AllocateOnDevice = std::function<void*(std::size_t bytes)>;

/// The stream of a call, and where its memory comes from. `kept` outlives the frame, `scratch` is
/// free once the call has returned: what comes later on the stream may overwrite it.
struct OperatorCall {
  int device = 0;
  void* stream = nullptr;  // cudaStream_t
  AllocateOnDevice kept, scratch;
};

/// What is kept of a picture that was drawn, for its gradient. Nothing changes it, so that gradients
/// can be asked for again and again, also where the caller has changed the picture.
class OperatorFrame {
 public:
  virtual ~OperatorFrame() = default;
  virtual const float* transmittance() const = 0;  // (H, W)
  /// Of Gaussians in tiles; the room, where one is given.
  virtual std::uint32_t instances() const = 0;
};

/// The operator of one kind of device.
class SplatOperator {
 public:
  virtual ~SplatOperator() = default;
  /// Draws Gaussians to `to`. Waits once, for the number of instances, where no room is given. Throws
  /// Error where the GPU fails. settings.background_on_device may replace the background.
  virtual std::unique_ptr<OperatorFrame> draw(const OperatorCall& call, const OperatorInput& input,
                                              const RenderSettings& settings,
                                              const OperatorPicture& to) const = 0;
  /// Pulls a gradient back to everything that draw() has read, whose arguments it takes again. Does
  /// not wait.
  virtual void pull_back(const OperatorCall& call, const OperatorFrame& frame,
                         const OperatorInput& input, const RenderSettings& settings,
                         const OperatorPictureGradient& dL,
                         const OperatorGradients& gradients) const = 0;
  /// Says where the Gaussians are, by the rules of another rasterizer. Does not wait.
  virtual void footprints(const OperatorCall& call, const OperatorInput& input,
                          const SplatSettings& settings, const FootprintRule& rule,
                          const OperatorFootprints& to) const = 0;
  /// Writes L to `value` and, where it is not null, dL/dX to dL_dimage, (planes, H, W). Does not wait.
  virtual void compare(const OperatorCall& call, const OperatorComparison& given, float* value,
                       float* dL_dimage) const = 0;

  // For callers that can keep bytes alone. What pull_back() reads of a frame with a room is as large
  // for every picture of the same input and settings.

  /// The bytes of that.
  virtual std::size_t kept_bytes(const OperatorInput& input,
                                 const RenderSettings& settings) const = 0;
  /// A frame for pull_back() alone, in `kept` memory of kept_bytes() that call.kept gives in pieces,
  /// one after the other: a copy of `copied`, or the one that such a call has left there before.
  virtual std::unique_ptr<OperatorFrame> frame_in(const OperatorCall& call,
                                                  const OperatorInput& input,
                                                  const RenderSettings& settings,
                                                  const OperatorFrame* copied = nullptr) const = 0;
};

}  // namespace gs
