// SPDX-License-Identifier: Apache-2.0
// One moment of Gaussians in space and time, as 3D Gaussians that every viewer knows.
#pragma once

#include "gs_core/gaussians.h"
#include "gs_core/math/spacetime/spacetime_splat.h"

namespace gs {

/// The parameters of a row without color, in double precision. The Gaussians have a time.
SpacetimeShape<double> spacetime_shape_of(const Gaussians& gaussians, std::size_t i);

/// The model at a time, 0 to 1: each Gaussian that is visible then, moved to where it is, with its
/// covariance and opacity of that moment (math/spacetime.h). It looks the same from everywhere up to
/// rounding, since the covariance is stored as a rotation and scales again. A model without time is
/// copied.
GaussianModel moment_of(const GaussianModel& model, double time);

/// Each Gaussian in the middle of its own life, where its opacity is highest: N rows in the order
/// of `gaussians`, of which no picture shows all at once. A row whose rotations have length 0 holds
/// NaN. The Gaussians have a time.
Gaussians middles_of_lives(const Gaussians& gaussians);

/// From when to when a Gaussian is drawn, in the scene's time; beyond 0 and 1 where it lives
/// longer.
struct Life {
  double begin, end;
};
Life life_of(const Gaussians& gaussians, std::size_t i);

}  // namespace gs
