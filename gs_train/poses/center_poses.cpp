// SPDX-License-Identifier: Apache-2.0
// The gauge of refined poses. A similarity of scene and cameras together changes no picture, so that
// nothing in the photos holds the scene at its place. It is held by the means over all photos.
#include "gs_train/poses/poses.h"

namespace gs {
namespace {

/// The motion of a row in the world's axes: the turn of the frame, and the shift of its pivot from
/// its given place, with the lever of that place from the mean of all photos.
struct WorldMotion {
  Vec3d turn, shift, lever;
  double weight;
};

std::vector<WorldMotion> world_motions(const PoseState& state) {
  Vec3d mean(0.0);
  double photos = 0;
  for (std::size_t row = 0; row < state.rows(); ++row) {
    mean += double(state.photos_of[row]) * state.frames[row].pivot;
    photos += double(state.photos_of[row]);
  }
  mean /= photos;
  std::vector<WorldMotion> motions;
  for (std::size_t row = 0; row < state.rows(); ++row) {
    const RigidFrame<double>& frame = state.frames[row];
    const RigidMotion<double> motion = state.motion(row);
    motions.push_back({-multiply_transposed(frame.axes, motion.turn),
                       multiply_transposed(frame.axes, motion.shift), frame.pivot - mean,
                       double(state.photos_of[row]) / photos});
  }
  return motions;
}

/// Writes a row's motion back where it is not what it was.
void set_motion(const WorldMotion& motion, std::size_t row, PoseState& state) {
  const Mat3<double>& axes = state.frames[row].axes;
  const Vec3d turn = -multiply(axes, motion.turn),
              shift = multiply(axes, motion.shift) / state.extent;
  float* const v = state.values.data() + kPoseNumbers * row;
  for (int k = 0; k < 3; ++k) v[k] = float(turn[k]), v[3 + k] = float(shift[k]);
}

}  // namespace

// To first order: turns and shifts are small. Levers have the mean zero, so that each step leaves the
// means of the others alone.
void center_poses(PoseState& state) {
  std::vector<WorldMotion> motions = world_motions(state);
  Vec3d turn(0.0), shift(0.0);
  for (const WorldMotion& motion : motions) {
    turn += motion.weight * motion.turn;
    shift += motion.weight * motion.shift;
  }
  double along = 0, levers = 0;
  for (WorldMotion& motion : motions) {
    motion.turn -= turn;
    motion.shift -= shift + cross(turn, motion.lever);
    along += motion.weight * inner(motion.shift, motion.lever);
    levers += motion.weight * inner(motion.lever, motion.lever);
  }
  const double scaling = levers > 0 ? along / levers : 0;
  for (std::size_t row = 0; row < motions.size(); ++row) {
    motions[row].shift -= scaling * motions[row].lever;
    set_motion(motions[row], row, state);
  }
}

}  // namespace gs
