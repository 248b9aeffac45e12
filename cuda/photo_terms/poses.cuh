// SPDX-License-Identifier: Apache-2.0
// Poses of training photos that are refined on the GPU. Twin of gs_train/poses/poses.cpp.
#pragma once

#include "cuda/photo_terms/photo_table.cuh"
#include "cuda/render/refined_camera.cuh"
#include "gs_train/poses/poses.h"
#include "gs_train/step.h"

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

class PoseStage : public PhotoTableStage {
 public:
  PoseStage(Context& context, Memory& memory)
      : PhotoTableStage("poses", context, memory), cameras_(memory), block_sums_(memory) {}

  PhotoTableUpdate update_of(const PoseState& state, const Update& update) const {
    return PhotoTableStage::update_of(state, update.pose_rate, update.photo_rule);
  }
  /// Before the photos of a step. Waits where the run is new.
  void begin(const PoseState& state);
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
  /// Between steps.
  void release_caches() { block_sums_.release(); }

 private:
  Buffer<DevicePose> cameras_;  // (kMostBatch)
  std::size_t blocks_ = 0;
  Buffer<double> block_sums_;  // (photos of a batch, blocks, 6)
};

}  // namespace gs::cuda
