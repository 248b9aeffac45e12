// SPDX-License-Identifier: Apache-2.0
// A Gaussian in space and time, seen as a 3D Gaussian that moves along a line.
#pragma once

#include "gs_core/math/spacetime/spacetime_splat.h"

namespace gs {

/// With S the covariance in 4D: time_scale = sqrt(S_tt), drift = S_xyz,t / time_scale, and rotation
/// and scales are those of the conditional covariance S_xyz - drift drift^T.
struct MovingGaussian {
  Vec3d mean;        // at the time time_mean, world units
  Vec3d drift;       // the way in the time of one time scale, world units
  double time_mean;  // 0 to 1 is the scene's duration
  double log_time_scale;
  Vec3d log_scale;        // of standard deviations, world units
  Quat<double> rotation;  // of length 1
};

/// Nothing is drawn of a shape with a degenerate quaternion: do not pass one.
MovingGaussian moving_gaussian(const SpacetimeShape<double>& shape);

/// A shape with the same covariance in 4D, up to rounding; its opacity is left at 0. Every number is
/// finite, and the rotation has a length above 0.
SpacetimeShape<double> shape_of(const MovingGaussian& moving);

}  // namespace gs
