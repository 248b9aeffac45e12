// SPDX-License-Identifier: Apache-2.0
// Scenes far from the origin (UTM: 500,000 east, 5,400,000 north) are moved near it in double
// precision, because single precision has steps of half a unit there.
#pragma once

#include <filesystem>

#include "data_loaders/colmap/colmap_model.h"
#include "gs_core/scene.h"

namespace gs {

/// The offset to take off all coordinates of a model: 0 unless single precision loses more than
/// 1e-4 of the cameras' spread at their place, else the median of the cameras, rounded to a power
/// of ten no larger than the spread. The spread is the distance from the median within which nine
/// in ten cameras stand; if it is 0, the same of the points.
Vec3d world_offset_of(const ColmapModel& model);

/// The same for a cloud of positions, of which single precision may lose `most_lost` of the spread.
Vec3d world_offset_of(const std::vector<Vec3d>& positions, double most_lost);

/// The center of an image's camera.   world units
Vec3d center_of(const ColmapImage& image);

/// Takes `offset` off the coordinates of a model, in double precision.
void take_off(ColmapModel& model, const Vec3d& offset);

/// Whether most positions are nearer to the offset than to 0, so that it was not taken off yet.
/// False for an offset of 0.
bool are_nearer_to(const Vec3d& offset, const std::vector<Vec3d>& positions);

/// Brings a loaded scene from its own offset to `offset`.
void bring_to_offset(Scene& scene, const Vec3d& offset);

/// "500000 5400000 0", with all digits that a double needs.
std::string text_of_offset(const Vec3d& offset);

/// Writes {"world_offset": [x, y, z]}; added to the run's coordinates it gives the scene's. The
/// file exists whole or not at all. Throws Error.
void write_world_offset(const std::filesystem::path& path, const Vec3d& offset);

}  // namespace gs
