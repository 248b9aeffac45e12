// SPDX-License-Identifier: Apache-2.0
// The camera of a photo before stage 1, of runs that refine poses. Twin of gs_train/poses/poses.cpp.
// No step waits for it: the cameras of later steps are made here from what earlier ones have
// learned.
#include "cuda/photo_terms/poses.cuh"

#include "cuda/stages.cuh"

namespace gs::cuda {
namespace {

__global__ void refine_kernel(PoseRow row, DevicePose* to) {
  const PinholeCamera<double> camera = moved(row.given, row.frame, row.motion());
  const Mat3<double>& R = camera.cam_from_world_rotation;
  *to = {{Vec3f(R.row0), Vec3f(R.row1), Vec3f(R.row2)}, Vec3f(camera.cam_from_world_translation)};
}

}  // namespace

void PoseStage::begin(const PoseState& state) {
  if (state.empty()) return;
  PhotoTableStage::begin(state);
  cameras_.resize(std::size_t(kMostBatch));
}

PoseRow PoseStage::row_of(const PoseState& state, std::size_t photo, const Camera& given) const {
  const std::size_t row = state.row_of[photo];
  return {state.row(row).data, gradient_of(state, row), state.frames[row], state.extent,
          camera_as<double>(given)};
}

const DevicePose* PoseStage::refine(const PoseRow& row, std::size_t i) {
  const StageScope scope(context_, name_);
  DevicePose* const pose = cameras_.data() + i;
  context_.launch(name_, refine_kernel, 1, 1, row, pose);
  return pose;
}

void PoseStage::reserve_sums(std::size_t photos, std::size_t rows) {
  blocks_ = camera_blocks(rows);
  block_sums_.resize_discard(photos * blocks_ * kPoseNumbers);
}

void PoseStage::add_gradient(const PoseRow& row, std::size_t i, double weight) {
  camera_gradient(context_, sums_of_blocks(i), blocks_, row, weight);
}

}  // namespace gs::cuda
