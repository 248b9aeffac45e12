// SPDX-License-Identifier: Apache-2.0
// The photometric model "gains" on the GPU: how a photo shows a pixel, and the stages that learn
// it; and the update of all models. Twin of gs_train/photometric/gains.cpp and
// gs_train/stages/photometric.cpp. ppisp.cuh has the model "ppisp".
#pragma once

#include <array>

#include "cuda/device/context.cuh"
#include "gs_core/math/adam.h"
#include "gs_core/math/photometric.h"
#include "gs_train/photometric/photometric_state.h"

namespace gs::cuda {

/// How a photo shows the scene's colors under gains. A kernel reads the numbers from the memory of
/// the device, because the host does not know what earlier steps have learned.
struct PhotoLook {
  const float* log_gains = nullptr;   // (3)
  const float* vignetting = nullptr;  // (3) of the camera; null: it is not learned
  LensPlace place{};

  explicit PhotoLook(const PhotoOnDevice* photo) {
    if (photo && photo->look == DeviceLook::gains)
      log_gains = photo->photo, vignetting = photo->camera, place = photo->place;
  }
  bool is_learned() const { return log_gains != nullptr; }

#ifdef __CUDACC__
  __device__ float photo_gain(int channel) const {
    return gained(1.0f, __ldg(log_gains + channel), 0.0f);
  }
  __device__ std::array<float, 3> lens() const {
    return {__ldg(vignetting), __ldg(vignetting + 1), __ldg(vignetting + 2)};
  }
  __device__ float rho(int x, int y) const { return place.rho(float(x) + 0.5f, float(y) + 0.5f); }
#endif
};

#ifdef __CUDACC__
/// What the lens leaves of the light at a pixel.
__device__ inline float lens_gain(const std::array<float, 3>& lens, float rho) {
  return gained(1.0f, 0.0f, log_vignetting(lens, rho));
}
#endif

/// What the blocks of a loss have added up over their pixels, each for one channel: the channel of
/// block i is i % 3. With G = dL/d(shown) * shown, weighted by the pixel's share:
///
///   x      sum G
///   y z w  sum G P_k    lens_polynomials(); 0 where no vignetting is learned
using LookSums = float4;

/// Adds the blocks' sums, in an order that is always the same, to the gradients of a photo and its
/// camera. Does nothing where the numbers rest.
void add_look_gradient(Context& context, Span<const LookSums> of_blocks,
                       const PhotoOnDevice& photo);

/// 8 for the photometric model: Adam for all photos and cameras by the sums, then the mean of the
/// photos becomes 0. Clears the gradient. Nothing is changed while `halted` is raised.
///
/// camera_of  (photos) PhotometricState::camera_of, on the device
/// gradient   (state.shape.size()) that of the data
void update_photometric(Context& context, DeviceLook look, const PhotometricState& state,
                        Span<const std::uint32_t> camera_of, Span<double> gradient,
                        const AdamStep& step, const AdamRule& rule, const std::uint32_t* halted);

}  // namespace gs::cuda
