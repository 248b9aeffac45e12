// SPDX-License-Identifier: Apache-2.0
// Stage 9 with model.filter_3d, behind RowOps::measure_filter().
#pragma once

#include <vector>

#include "cuda/device/context.cuh"
#include "gs_core/camera.h"
#include "gs_core/gaussians.h"

namespace gs::cuda {

/// filter_3d.cu: measures the 3D filter of each row. The host does not wait.
class FilterMeter {
 public:
  FilterMeter(Context& context, Memory& memory)
      : context_(context), cameras_(memory), largest_(memory) {}
  void measure(Gaussians& rows, const std::vector<Camera>& cameras, float near_plane);
  void release() { cameras_.release(); }

 private:
  Context& context_;
  Buffer<Camera> cameras_;
  Buffer<std::uint32_t> largest_;  // (1)  bits of the largest filter of the rows that are seen
};

}  // namespace gs::cuda
