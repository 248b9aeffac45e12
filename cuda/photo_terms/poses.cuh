// SPDX-License-Identifier: Apache-2.0
// Poses of training photos that are refined on the GPU. Twin of gs_train/poses/poses.cpp.
#pragma once

#include <vector>

#include "cuda/device/context.cuh"
#include "cuda/render/refined_camera.cuh"
#include "gs_core/buffer.h"
#include "gs_core/math/update/adam.h"
#include "gs_train/poses/pose_state.h"

namespace gs::cuda {

/// What a kernel needs of the row of one photo.
struct PoseRow {
  const float* values;  // (6)
  double* gradient;     // (6) += dL/d(values)
  RigidFrame<double> frame;
  double extent;
  PinholeCamera<double> given;  // the photo's camera before it was refined

#ifdef __CUDACC__
  __device__ RigidMotion<double> motion() const {
    return {Vec3d(values[0], values[1], values[2]),
            extent * Vec3d(values[3], values[4], values[5])};
  }
#endif
};

/// The motions of all rows with their moments and gradients. Between upload() and download() those
/// of the PoseState are older. Only these two wait; upload() does not if it would change nothing,
/// as in the first step after a download().
class DevicePoses {
 public:
  DevicePoses(Context& context, Memory& memory)
      : context_(context), values_(memory), moments_(memory), modes_(memory), gradient_(memory),
        cameras_(memory), block_sums_(memory) {}

  void upload(const PoseState& state);
  void download(PoseState& state);

  PoseRow row_of(const PoseState& state, std::size_t photo, const Camera& given) const;
  /// Photo i of a batch has the camera of this row from now on. Returns its pose, on the device.
  const DevicePose* refine(const PoseRow& row, std::size_t i);
  /// Before a step by so many photos of a model of so many rows: makes room for what
  /// add_camera_blocks() leaves of each photo.
  void reserve_sums(std::size_t photos, std::size_t rows);
  double* sums_of_blocks(std::size_t photo) const {
    return block_sums_.data() + photo * blocks_ * kPoseNumbers;
  }
  /// After add_camera_blocks() of photo i on all GPUs: adds the gradient of its pose.
  void add_gradient(const PoseRow& row, std::size_t i, double weight);
  /// 8 for poses: Adam for all rows by their gradients and the pull; then what all photos have in
  /// common is taken out of the motions. Clears the gradients. Nothing is changed while `halted` is
  /// raised.
  void update(const AdamStep& step, const AdamRule& rule, const std::uint32_t* halted);
  void clear_gradient() { gradient_.fill_zero(); }
  /// Between steps.
  void release_caches() { block_sums_.release(); }

 private:
  bool holds(const PoseState& state) const;

  Context& context_;
  // What the last download has brought; no values: an update came after it.
  std::vector<float> held_values_;
  std::vector<FloatMoments> held_moments_;
  std::vector<std::vector<double>> held_modes_;  // those of modes_
  Buffer<float> values_;                         // (rows, 6)
  Buffer<FloatMoments> moments_;                 // (rows, 6)
  Buffer<double> modes_;                         // (modes, rows, 6) PoseState::common_modes
  Buffer<double> gradient_;                      // (rows, 6) zero between steps
  Buffer<DevicePose> cameras_;                   // (kMostBatch)
  std::size_t blocks_ = 0;
  Buffer<double> block_sums_;  // (photos of a batch, blocks, 6)
};

}  // namespace gs::cuda
