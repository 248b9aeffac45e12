// SPDX-License-Identifier: Apache-2.0
// The motions of cameras that a run learns, part of TrainingModel.
#pragma once

#include <cstdint>
#include <vector>

#include "gs_core/math/pose/pose.h"
#include "gs_train/photo_table.h"

namespace gs {

inline constexpr std::size_t kPoseNumbers = 6;  // of a row: three of the turn, three of the shift

/// What moves as one: the training photos that a rig took at one moment, or one photo. It follows
/// from the scene, and checkpoints do not have it.
struct PoseFrames {
  std::vector<std::uint32_t> row_of;       // (training photos)
  std::vector<RigidFrame<double>> frames;  // (rows) at the given poses
  std::vector<Vec3d> centers;              // (rows) mean of its cameras' centers, world units
  double extent = 1;                       // of the scene: the unit of shifts
};

/// A row for each frame: its turn in radians and its shift in extents, in the axes of the frame; 0:
/// as given. The modes, at most 7, are what a similarity makes of all motions (center_poses.cpp).
struct PoseState : PhotoTable, PoseFrames {
  using PhotoTable::PhotoTable;

  /// In host memory.
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

/// A copy in another memory.
inline PoseState copy_to(Memory& memory, const PoseState& from) {
  PoseState state(memory);
  copy_table(from, state);
  static_cast<PoseFrames&>(state) = static_cast<const PoseFrames&>(from);
  return state;
}

}  // namespace gs
