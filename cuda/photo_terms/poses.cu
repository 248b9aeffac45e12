// SPDX-License-Identifier: Apache-2.0
// The camera of a photo before stage 1, and the update of all poses with stage 8, of runs that
// refine poses. Twin of gs_train/poses/poses.cpp and center_poses.cpp. No step waits for them: the
// cameras of later steps are made here from what earlier ones have learned.
//
// The update is a single block, because there are few numbers, and because all sums then have an
// order of their own: the same bits come out each time. Sums are in double, as in the scalar twin.
#include "cuda/photo_terms/poses.cuh"

#include "cuda/device/block_sums.cuh"
#include "cuda/stages.cuh"
#include "gs_core/config/config.h"

namespace gs::cuda {
namespace {

constexpr int kThreads = 256;  // of the update; a power of two for the sums

__global__ void refine_kernel(PoseRow row, DevicePose* to) {
  const PinholeCamera<double> camera = moved(row.given, row.frame, row.motion());
  const Mat3<double>& R = camera.cam_from_world_rotation;
  *to = {{Vec3f(R.row0), Vec3f(R.row1), Vec3f(R.row2)}, Vec3f(camera.cam_from_world_translation)};
}

/// All rows on the device.
struct Rows {
  float* values;
  FloatMoments* moments;
  double* gradient;
  const double* modes;  // (mode_count, count)
  int count, mode_count;
};

/// Thread t takes the numbers t, t + kThreads, ... in all loops.
__global__ void __launch_bounds__(kThreads)
    update_kernel(Rows rows, AdamStep step, AdamRule rule, const std::uint32_t* halted) {
  if (*halted) return;
  const double weight = kPosePull * kPoseNumbers / double(rows.count);
  for (int i = int(threadIdx.x); i < rows.count; i += kThreads) {
    const double sigma = i % int(kPoseNumbers) < 3 ? kPoseSpreadTurn : kPoseSpreadShift;
    const double of_pull = weight * double(rows.values[i]) / (sigma * sigma);
    adam_update(rows.values[i], rows.moments[i], float(rows.gradient[i] + of_pull), step, rule);
    rows.gradient[i] = 0;
  }
  __shared__ double shared[1][kThreads];
  for (int k = 0; k < rows.mode_count; ++k) {
    const double* const mode = rows.modes + std::size_t(k) * std::size_t(rows.count);
    double sum[1] = {0};
    for (int i = int(threadIdx.x); i < rows.count; i += kThreads)
      sum[0] += mode[i] * double(rows.values[i]);
    __syncthreads();  // all have read the share before
    sum_by_remainder<1>(sum, shared);
    const double share = shared[0][0];
    for (int i = int(threadIdx.x); i < rows.count; i += kThreads)
      rows.values[i] = float(double(rows.values[i]) - share * mode[i]);
  }
}

}  // namespace

bool DevicePoses::holds(const PoseState& state) const {
  return !held_values_.empty() && state.values == held_values_ && state.moments == held_moments_ &&
         state.common_modes == held_modes_;
}

void DevicePoses::upload(const PoseState& state) {
  if (holds(state)) return;
  held_values_.clear();
  held_modes_ = state.common_modes;
  values_.upload(state.values);
  moments_.upload(state.moments);
  std::vector<double> modes;
  for (const std::vector<double>& mode : state.common_modes)
    modes.insert(modes.end(), mode.begin(), mode.end());
  modes_.upload(modes);
  gradient_.resize_discard(state.values.size());
  gradient_.fill_zero();
  cameras_.resize(std::size_t(kMostBatch));
}

void DevicePoses::download(PoseState& state) {
  state.values = held_values_ = values_.download();
  state.moments = held_moments_ = moments_.download();
}

PoseRow DevicePoses::row_of(const PoseState& state, std::size_t photo, const Camera& given) const {
  const std::size_t row = state.row_of[photo];
  return {values_.data() + kPoseNumbers * row, gradient_.data() + kPoseNumbers * row,
          state.frames[row], state.extent, camera_as<double>(given)};
}

const DevicePose* DevicePoses::refine(const PoseRow& row, std::size_t i) {
  const StageScope scope(context_, "poses");
  DevicePose* const pose = cameras_.data() + i;
  context_.launch("poses", refine_kernel, 1, 1, row, pose);
  return pose;
}

void DevicePoses::reserve_sums(std::size_t photos, std::size_t rows) {
  blocks_ = camera_blocks(rows);
  block_sums_.resize_discard(photos * blocks_ * kPoseNumbers);
}

void DevicePoses::add_gradient(const PoseRow& row, std::size_t i, double weight) {
  camera_gradient(context_, sums_of_blocks(i), blocks_, row, weight);
}

void DevicePoses::update(const AdamStep& step, const AdamRule& rule, const std::uint32_t* halted) {
  const StageScope scope(context_, "poses");
  held_values_.clear();  // they are older from now on
  const std::size_t count = values_.size();
  context_.launch("poses", update_kernel, 1, kThreads,
                  Rows{values_.data(), moments_.data(), gradient_.data(), modes_.data(), int(count),
                       int(modes_.size() / count)},
                  step, rule, halted);
}

}  // namespace gs::cuda
