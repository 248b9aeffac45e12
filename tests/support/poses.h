// SPDX-License-Identifier: Apache-2.0
// Poses that are disturbed, for tests of runs that refine them.
#pragma once

#include "gs_train/poses/poses.h"
#include "tests/support/small_scene.h"

namespace gs {

/// Adds a small motion of a row, in the axes of the world: a turn, and a shift of its center.
inline void add_motion(PoseState& state, std::size_t row, const Vec3d& turn, const Vec3d& shift) {
  const RigidFrame<double>& frame = state.frames[row];
  const Vec3d of_pivot = shift + cross(turn, frame.pivot - state.centers[row]);
  const Vec3d w = -multiply(frame.axes, turn), v = multiply(frame.axes, of_pivot) / state.extent;
  for (int k = 0; k < 3; ++k) {
    state.values[6 * row + std::size_t(k)] += float(w[k]);
    state.values[6 * row + std::size_t(3 + k)] += float(v[k]);
  }
}

/// Turns each row by `turn` radians about a random axis, and shifts its center by `shift` extents
/// along another one.
inline void disturb(PoseState& state, double turn, double shift, std::uint64_t seed = 3) {
  Draws draws(seed);
  const auto direction = [&] {
    const Vec3d v(draws.normal(), draws.normal(), draws.normal());
    return v / std::sqrt(inner(v, v));
  };
  for (std::size_t row = 0; row < state.rows; ++row) {
    const Vec3d by_turn = turn * direction();
    add_motion(state, row, by_turn, shift * state.extent * direction());
  }
}

/// Moves all rows as a similarity of the world near the identity does, to first order.
inline void add_similarity(PoseState& state, const Vec3d& turn, const Vec3d& shift,
                           double scaling) {
  Vec3d mean(0.0);
  for (const Vec3d& center : state.centers) mean += center / double(state.rows);
  for (std::size_t row = 0; row < state.rows; ++row) {
    const Vec3d lever = state.centers[row] - mean;
    add_motion(state, row, turn, shift + cross(turn, lever) + scaling * lever);
  }
}

inline double largest_difference(const std::vector<float>& a, const std::vector<float>& b) {
  double largest = 0;
  for (std::size_t i = 0; i < a.size(); ++i)
    largest = std::max(largest, std::abs(double(a[i]) - double(b[i])));
  return largest;
}

/// The angle between the axes of two cameras, and the distance of their centers: root mean squares.
struct PoseError {
  double degrees, shift;
};
inline PoseError pose_error(const std::vector<Camera>& cameras, const std::vector<Camera>& truth) {
  double angles = 0, shifts = 0;
  for (std::size_t i = 0; i < truth.size(); ++i) {
    const auto a = camera_as<double>(cameras[i]), b = camera_as<double>(truth[i]);
    const Mat3<double>&A = a.cam_from_world_rotation, &B = b.cam_from_world_rotation;
    const auto squared = [](const Vec3d& v) { return inner(v, v); };
    const double chord2 =
        squared(A.row0 - B.row0) + squared(A.row1 - B.row1) + squared(A.row2 - B.row2);
    const double angle = 2 * std::asin(std::min(1.0, std::sqrt(chord2 / 8)));
    angles += angle * angle;
    shifts += squared(a.position() - b.position());
  }
  const double count = double(truth.size());
  return {std::sqrt(angles / count) * 180 / std::numbers::pi, std::sqrt(shifts / count)};
}

}  // namespace gs
