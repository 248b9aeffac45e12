// SPDX-License-Identifier: Apache-2.0
// Reads the Gaussians and the cameras that callers of the operator give, in any of their forms.
#pragma once

#include "cuda/render/refined_camera.cuh"
#include "gs_core/math/render/splat.h"
#include "gs_render/operator.h"

namespace gs::cuda {

__device__ inline Vec3f vector_at(const float* row) { return {row[0], row[1], row[2]}; }
__device__ inline void store(float* row, const Vec2f& v) { row[0] = v.x, row[1] = v.y; }
__device__ inline void store(float* row, const Vec3f& v) {
  row[0] = v.x, row[1] = v.y, row[2] = v.z;
}

/// The camera of a call, whose numbers may lie on the device, but not its lens.
template <bool has_lens>
__device__ inline Camera camera_of(const OperatorInput& in) {
  Camera camera = refined<has_lens>(in.camera, nullptr);
  if (const float* const m = in.viewmat) {
    camera.cam_from_world_rotation = {vector_at(m), vector_at(m + 4), vector_at(m + 8)};
    camera.cam_from_world_translation = {m[3], m[7], m[11]};
  }
  if (const float* const K = in.K)
    camera.fx = K[0], camera.cx = K[2], camera.fy = K[4], camera.cy = K[5];
  return camera;
}

/// The shape and the opacity of a Gaussian, with what their gradients need.
struct GivenShape {
  Mat3<float> R;  // undefined with covariances, like the next two
  Quatf rotation;
  Vec3f scale, variances;
  Sym3<float> sigma;
  float opacity;
  bool is_degenerate;
};
__device__ inline GivenShape shape_of(const OperatorInput& in, std::size_t i) {
  GivenShape shape;
  const float opacity = *in.arrays.opacities[i];
  shape.opacity = in.has_logit_opacities ? sigmoid(opacity) : opacity;
  shape.is_degenerate = false;
  if (in.arrays.covariances.data) {
    const float* const row = in.arrays.covariances[i];
    shape.sigma = {row[0], row[1], row[2], row[3], row[4], row[5]};
    return shape;
  }
  const float* const q = in.arrays.rotations[i];
  shape.rotation = {q[0], q[1], q[2], q[3]};
  shape.is_degenerate = is_degenerate(shape.rotation);
  shape.R = rotation_matrix(shape.rotation);
  shape.scale = vector_at(in.arrays.scales[i]);
  shape.variances = in.has_log_scales ? variance(shape.scale) : shape.scale * shape.scale;
  shape.sigma = covariance(shape.R, shape.variances);
  return shape;
}

}  // namespace gs::cuda
