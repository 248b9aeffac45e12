// SPDX-License-Identifier: Apache-2.0
// The motions of cameras that a run learns, part of TrainingModel.
#pragma once

#include <cstdint>
#include <vector>

#include "gs_core/math/pose/pose.h"
#include "gs_core/math/update/adam_moments.h"

namespace gs {

inline constexpr std::size_t kPoseNumbers = 6;  // of a row: three of the turn, three of the shift

/// One row for each rigid frame: the training photos that a rig took at one moment, or one photo.
/// All arrays are in host memory. A device updates copies of its own during the steps, and
/// Backend::synchronize() brings them back.
struct PoseState {
  // These follow from the scene; checkpoints do not have them.
  std::vector<std::uint32_t> row_of;       // (training photos)
  std::vector<RigidFrame<double>> frames;  // (rows) at the given poses
  std::vector<Vec3d> centers;              // (rows) mean of its cameras' centers, world units
  double extent = 1;                       // of the scene: the unit of shifts
  // (at most 7) of (rows, 6): orthonormal, what a similarity makes of all motions
  // (center_poses.cpp)
  std::vector<std::vector<double>> common_modes;
  // (rows, 6) turn in radians and shift in extents, in the axes of the frame; 0: as given
  std::vector<float> values;
  std::vector<FloatMoments> moments;  // of Adam, of each value
  int adam_steps = 0;         // updates; fewer than the model's, because poses rest at times
  bool is_on_device = false;  // values and moments there are newer

  bool empty() const { return values.empty(); }
  std::size_t rows() const { return values.size() / kPoseNumbers; }
  RigidMotion<double> motion(std::size_t row) const {
    const float* const v = values.data() + kPoseNumbers * row;
    return {Vec3d(v[0], v[1], v[2]), extent * Vec3d(v[3], v[4], v[5])};
  }
};

/// Calls f(name, a.array, b.array, ...) for each array. Checkpoints name their sections like this.
template <class F, class First, class... Rest>
void for_each_pose_array(F&& f, First&& first, Rest&&... rest) {
  f("poses.values", first.values, rest.values...);
  f("poses.moments", first.moments, rest.moments...);
}

}  // namespace gs
