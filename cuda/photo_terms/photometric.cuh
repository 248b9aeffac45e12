// SPDX-License-Identifier: Apache-2.0
// The photometric model "gains" on the GPU: how a photo shows a pixel, and the stages that learn
// it. Twin of gs_train/photometric/gains.cpp and gs_train/stages/photometric.cpp.
#pragma once

#include "cuda/device/context.cuh"
#include "gs_core/math/loss/photometric.h"
#include "gs_core/math/update/adam.h"
#include "gs_train/photometric/photometric_state.h"

namespace gs::cuda {

/// How a photo shows the scene's colors. A kernel reads the numbers from the memory of the device,
/// because the host does not know what earlier steps have learned.
struct PhotoLook {
  const float* log_gains = nullptr;  // (3)

  explicit PhotoLook(const PhotoOnDevice* photo) {
    if (photo) log_gains = photo->photo;
  }

#ifdef __CUDACC__
  __device__ float photo_gain(int channel) const {
    return gained(1.0f, __ldg(log_gains + channel));
  }
#endif
};

/// Adds what the blocks of a loss have summed up over their pixels, in an order that is always the
/// same, to the gradient of a photo. Does nothing where the numbers rest.
///
/// of_blocks  sum G of each block, where G = dL/d(shown) * shown, weighted by the pixel's share.
///            The channel of block i is i % 3
void add_look_gradient(Context& context, Span<const float> of_blocks, const PhotoOnDevice& photo);

/// 8 for the photometric model: Adam for all photos by the sums, then their mean becomes 0. Clears
/// the gradient. Nothing is changed while `halted` is raised.
///
/// gradient   (state.shape.size()) that of the data
void update_photometric(Context& context, const PhotometricState& state, Span<double> gradient,
                        const AdamStep& step, const AdamRule& rule, const std::uint32_t* halted);

}  // namespace gs::cuda
