// SPDX-License-Identifier: Apache-2.0
// The photometric model "ppisp" on the GPU: how a photo shows a color, and the passes before and
// after the loss. Twin of gs_train/photometric/ppisp.cpp.
#pragma once

#include <array>

#include "cuda/train/photometric.cuh"
#include "gs_core/math/ppisp.h"
#include "gs_render/render_pass.h"

namespace gs::cuda {

/// How a photo shows the scene's colors. Kernels read the numbers from the memory of the device.
struct PpispLook {
  const float* numbers;     // (9) exposure and latents
  const float* vignetting;  // (3) of the camera; null: it is not learned
  LensPlace place;

  explicit PpispLook(const PhotoOnDevice& photo)
      : numbers(photo.photo), vignetting(photo.camera), place(photo.place) {}
};

#ifdef __CUDACC__
/// The same in a thread's registers.
struct PpispColors {
  float exposure;  // 2^t
  ColorMatrix<float> matrix;
  std::array<float, 3> b{};
  LensPlace place;
  bool has_lens;

  __device__ explicit PpispColors(const PpispLook& look)
      : exposure(exp2f(__ldg(look.numbers))), place(look.place),
        has_lens(look.vignetting != nullptr) {
    ColorLatents<float> latents;
    for (int i = 0; i < 8; ++i) latents[std::size_t(i)] = __ldg(look.numbers + 1 + i);
    matrix = color_matrix(latents);
    if (has_lens)
      b = {__ldg(look.vignetting), __ldg(look.vignetting + 1), __ldg(look.vignetting + 2)};
  }
  __device__ float rho(int x, int y) const { return place.rho(float(x) + 0.5f, float(y) + 0.5f); }
  /// What exposure and lens make of the light at a pixel.
  __device__ float gain(float at_rho) const {
    return has_lens ? exposure * lens_gain(b, at_rho) : exposure;
  }
  __device__ Vec3f shown(const Vec3f& color, float at_rho) const {
    return gain(at_rho) * recolored(matrix, color);
  }
};
#endif

/// The picture of a pass as such a photo shows it, and the way back. The loss compares it in place
/// of the rendered one.
class RecoloredPicture {
 public:
  RecoloredPicture(Context& context, Memory& memory)
      : context_(context), shown_(memory), behind_(memory), sums_(memory) {}

  /// Computes shown() and, for photos over the background, behind().
  void show(const RenderPass& pass, const PhotoOnDevice& photo, bool over_background);
  const float* shown() const { return shown_.data(); }    // (3, H, W)
  const float* behind() const { return behind_.data(); }  // (3, H, W) the background as it is shown

  /// Turns dL/d(shown) into dL/d(image), and adds the gradient of the photo's and the camera's
  /// numbers to that of `photo`, in an order that is always the same; not where they rest. A pixel
  /// of a photo over the background teaches as much as the `cover` says; null: all of it.
  void pull_back(const RenderPass& pass, const PhotoOnDevice& photo, const std::uint8_t* cover,
                 float* dL_dshown);

 private:
  Context& context_;
  Buffer<float> shown_, behind_;
  Buffer<float> sums_;  // (blocks, 16) of pull_back()
};

}  // namespace gs::cuda
