// SPDX-License-Identifier: Apache-2.0
// A camera whose pose only the device knows, because steps under way are still refining it. Kernels
// of training are templates over what they get: a Camera, or a RefinedCamera, whose pose they read
// from memory. So kernels for a given Camera are as they would be without refinement.
#pragma once

#include <utility>

#include "gs_core/camera.h"

namespace gs::cuda {

/// cam_from_world, in the memory of the device.
struct DevicePose {
  Mat3<float> rotation;
  Vec3f translation;
};

struct RefinedCamera {
  Camera given;  // its size, lens and time count
  const DevicePose* pose;
};

/// Calls f(source) with what the kernels of a camera get; `pose` is null where the camera stays as
/// it is given.
template <class F>
void with_camera(const Camera& camera, const DevicePose* pose, F&& f) {
  if (pose)
    std::forward<F>(f)(RefinedCamera{camera, pose});
  else
    std::forward<F>(f)(camera);
}

#ifdef __CUDACC__
__device__ inline const Camera& camera_of(const Camera& camera) { return camera; }
__device__ inline Camera camera_of(const RefinedCamera& refined) {
  Camera camera = refined.given;
  camera.cam_from_world_rotation = refined.pose->rotation;
  camera.cam_from_world_translation = refined.pose->translation;
  return camera;
}
#endif

}  // namespace gs::cuda
