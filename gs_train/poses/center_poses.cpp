// SPDX-License-Identifier: Apache-2.0
// The gauge of refined poses. A similarity of scene and cameras together changes no picture, so
// that nothing in the photos holds the scene at its place. What a similarity of all cameras would
// explain is therefore taken out of their motions, by least squares.
#include <cmath>

#include "gs_train/poses/poses.h"

namespace gs {
namespace {

constexpr double kLeastMode = 1e-6;  // share of its length that a mode has beyond all earlier ones

using Numbers = std::vector<double>;  // (rows, 6)

double product_of(const Numbers& a, const Numbers& b) {
  double sum = 0;
  for (std::size_t i = 0; i < a.size(); ++i) sum += a[i] * b[i];
  return sum;
}

/// Writes a motion of a row, given in the world's axes: its turn, and the shift of its pivot.
void set_row(const PoseFrames& state, std::size_t row, const Vec3d& turn, const Vec3d& shift,
             Numbers& numbers) {
  const Mat3<double>& axes = state.frames[row].axes;
  const Vec3d w = -multiply(axes, turn), v = multiply(axes, shift) / state.extent;
  for (int k = 0; k < 3; ++k) {
    numbers[kPoseNumbers * row + std::size_t(k)] = w[k];
    numbers[kPoseNumbers * row + std::size_t(3 + k)] = v[k];
  }
}

/// The motions of all rows under small similarities: turns about three axes, shifts along them, and
/// the scaling, which moves centers and turns nothing.
std::vector<Numbers> similarities(const PoseFrames& state) {
  Vec3d middle(0.0);
  for (const Vec3d& center : state.centers) middle += center / double(state.centers.size());
  std::vector<Numbers> modes(7, Numbers(kPoseNumbers * state.frames.size()));
  for (std::size_t row = 0; row < state.frames.size(); ++row) {
    for (int k = 0; k < 3; ++k) {
      Vec3d axis(0.0);
      axis[k] = 1;
      set_row(state, row, axis, cross(axis, state.frames[row].pivot - middle),
              modes[std::size_t(k)]);
      set_row(state, row, Vec3d(0.0), axis, modes[std::size_t(3 + k)]);
    }
    set_row(state, row, Vec3d(0.0), state.centers[row] - middle, modes[6]);
  }
  return modes;
}

}  // namespace

// Gram and Schmidt. Where all cameras stand at one place, for example, there is no scaling.
std::vector<Numbers> common_modes(const PoseFrames& state) {
  std::vector<Numbers> modes;
  for (Numbers& mode : similarities(state)) {
    const double before = std::sqrt(product_of(mode, mode));
    for (int twice = 0; twice < 2; ++twice)  // once leaves rounding errors of nearly equal modes
      for (const Numbers& other : modes) {
        const double share = product_of(mode, other);
        for (std::size_t i = 0; i < mode.size(); ++i) mode[i] -= share * other[i];
      }
    const double length = std::sqrt(product_of(mode, mode));
    if (!(length > kLeastMode * before)) continue;
    for (double& number : mode) number /= length;
    modes.push_back(std::move(mode));
  }
  return modes;
}

}  // namespace gs
