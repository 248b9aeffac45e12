// SPDX-License-Identifier: Apache-2.0
// The photometric loss' contract: L = (1 - lambda) mean|X - Y| + lambda (1 - SSIM(X, Y))   Kerbl et al. 2023, Eq. 7
#pragma once

#include "gs_core/buffer.h"
#include "gs_core/scene.h"
#include "gs_render/render_pass.h"

namespace gs {

class Loss {
 public:
  virtual ~Loss() = default;
  /// Compares the pass's picture with the view's photo and writes dL/d(image), (3, H, W), into dL_dimage.
  virtual void forward_backward(const RenderPass& pass, const View& view, float lambda_dssim,
                                Buffer<float>& dL_dimage) = 0;
  /// The loss of the last call. On a device this waits for it; the trainer asks only when it logs.
  virtual double value() = 0;
};

}  // namespace gs
