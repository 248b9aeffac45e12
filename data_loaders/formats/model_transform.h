// SPDX-License-Identifier: Apache-2.0
// Where a model is put when it leaves: turned, moved and scaled as a whole, its SH coefficients with it.
#pragma once

#include "gs_core/gaussians.h"

namespace gs {

/// placed = scale * R (x - center)
struct ModelTransform {
  Vec3d center{0.0, 0.0, 0.0};     // world units; of the model, goes to the origin
  Quat<double> turn{1, 0, 0, 0};   // R, of length 1
  double scale = 1;                // > 0

  bool turns_or_scales() const { return turn.w != 1 || scale != 1; }
  bool is_identity() const { return !turns_or_scales() && center == Vec3d(0.0); }
};

/// The shortest turn that takes the direction `up`, of the PLY's axes and not 0, to -y: what viewers show at the top.
Quat<double> turn_upright(const Vec3d& up);

/// The median of the means, on each axis by itself; finite means only, 0 where there are none.
Vec3d median_mean(const GaussianModel& model);

/// Moves the model. World offsets go along: after a mere shift, mean + world_offset is what it was; after a turn or
/// scaling there is none.
void place(GaussianModel& model, const ModelTransform& transform);

/// The transform that takes a placed model back.
ModelTransform inverse_of(const ModelTransform& transform);

/// x -> scale * R (x - center), in homogeneous coordinates, by rows.
struct Mat4d {
  double m[4][4];
};
Mat4d matrix_of(const ModelTransform& transform);
Mat4d multiply(const Mat4d& a, const Mat4d& b);
Mat4d diagonal(const Vec3f& signs);
Mat4d translation(const Vec3d& by);
/// The inverse of a matrix that turns, mirrors, scales evenly and moves.
Mat4d inverse_of(const Mat4d& similarity);

}  // namespace gs
