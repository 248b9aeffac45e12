// SPDX-License-Identifier: Apache-2.0
// Where to stand in a model without cameras whose walls hide its middle from outside.
#pragma once

#include <optional>

#include "gs_core/gaussians.h"
#include "gs_core/geometry/scene_frame.h"

namespace gs {

/// A place between the middle and the walls, a little above the middle. The surfaces around the
/// frame's center are counted by direction and distance. They are walls if in three of four
/// directions free space lies before them, with something in the middle of it: a shell around
/// nothing may as well be a hollow object, which is looked at from outside. Nothing where these are
/// no walls. Gaussians without time and without a 3D filter.
std::optional<Vec3d> eye_inside(const Gaussians& gaussians, const SceneFrame& frame);

}  // namespace gs
