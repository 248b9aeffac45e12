// SPDX-License-Identifier: Apache-2.0
// Which way is up in a model, and where its floor is.
#pragma once

#include "gs_core/gaussians.h"

namespace gs {

/// The up direction of a model without cameras: the one along which the most Gaussians have the
/// same height, because floors, tables and steps are level. Heights are counted in a hundred steps
/// of the model's radius; each Gaussian counts by opacity and surface, and the sum of the squared
/// counts is largest for the direction. All directions within 45 degrees of -y, which is up in
/// COLMAP's axes, are compared; a direction at the limit is that of a wall beyond it, and none.
/// Faint Gaussians, and the tenth that is farthest from the median, are left out.
///
/// Unit length; -y where no Gaussian says anything, and for a wall. Gaussians without time and
/// without a 3D filter.
Vec3d up_of_levels(const Gaussians& gaussians);

/// The height of the floor along `up` (unit length), relative to `center`: of the Gaussians that
/// are not faint and not farther from the center than `radius`, one in fifty lies lower. 0 where
/// there is none.   world units
double floor_height(const Gaussians& gaussians, const Vec3d& up, const Vec3d& center,
                    double radius);

}  // namespace gs
