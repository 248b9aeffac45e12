// SPDX-License-Identifier: Apache-2.0
// A camera whose pose only the device knows, because steps under way are still refining it. Kernels
// of training get the camera as it was given and a pointer to that pose, which is null in runs that
// do not refine poses.
#pragma once

#include "gs_core/camera.h"

namespace gs::cuda {

/// cam_from_world, in the memory of the device.
struct DevicePose {
  Mat3<float> rotation;
  Vec3f translation;
};

#ifdef __CUDACC__
/// The camera with this pose; null: as it is given. Kernels have an instance for pinholes, in which
/// the compiler leaves the code of lenses out.
template <bool has_lens>
__device__ Camera refined(const Camera& given, const DevicePose* pose) {
  Camera camera = given;
  if constexpr (!has_lens) camera.lens = {};
  if (pose) {
    camera.cam_from_world_rotation = pose->rotation;
    camera.cam_from_world_translation = pose->translation;
  }
  return camera;
}
#endif

}  // namespace gs::cuda
