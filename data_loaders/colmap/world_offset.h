// SPDX-License-Identifier: Apache-2.0
// The offset of a whole model of COLMAP (gs_core/geometry/world_offset.h).
#pragma once

#include "data_loaders/colmap/colmap_model.h"
#include "gs_core/geometry/world_offset.h"
#include "gs_core/scene.h"

namespace gs {

/// The offset that keeps 1e-4 of the cameras' spread; of the points' spread if all cameras stand in
/// one place.
Vec3d world_offset_of(const ColmapModel& model);

/// The center of an image's camera.   world units
Vec3d center_of(const ColmapImage& image);

/// Takes `offset` off the coordinates of a model, in double precision.
void take_off(ColmapModel& model, const Vec3d& offset);

/// Brings a loaded scene from its own offset to `offset`.
void bring_to_offset(Scene& scene, const Vec3d& offset);

}  // namespace gs
