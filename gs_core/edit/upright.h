// SPDX-License-Identifier: Apache-2.0
// Which way is up in a model, and where its floor is.
#pragma once

#include "gs_core/gaussians.h"

namespace gs {

/// The up direction of a model without cameras, from the flat Gaussians of its floor and of other
/// level surfaces. Each flat Gaussian has a normal, its thinnest axis, which counts by opacity,
/// surface and flatness. The direction starts at -y, which is up in COLMAP's axes, and goes to the
/// mean of all normals within a cone around it, several times, while the cone becomes narrower.
///
/// Unit length; -y where no Gaussian says anything. A floor that is tilted by more than 45 degrees
/// is not found. Gaussians without time.
Vec3d up_of_surfaces(const Gaussians& gaussians);

/// The height of the floor along `up` (unit length), relative to `center`: of the Gaussians that are
/// not faint and not farther from the center than `radius`, one in fifty lies lower. 0 where there
/// is none.   world units
double floor_height(const Gaussians& gaussians, const Vec3d& up, const Vec3d& center,
                    double radius);

}  // namespace gs
