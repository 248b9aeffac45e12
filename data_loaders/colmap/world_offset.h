// SPDX-License-Identifier: Apache-2.0
// Scenes far from the origin (UTM: 500,000 east, 5,400,000 north) are moved near it, in double precision, for single
// precision would have steps of half a unit there.
#pragma once

#include <filesystem>

#include "data_loaders/colmap/colmap_model.h"
#include "gs_core/scene.h"

namespace gs {

/// What to take off all coordinates of a model: 0 unless single precision would lose more than 1e-4 of the cameras' spread
/// where they stand, else their median, rounded to a power of ten no larger than that spread. The spread is the distance from
/// the median that nine in ten of the cameras keep; where it is 0, of the points.
Vec3d world_offset_of(const ColmapModel& model);

/// The same for a cloud of positions, of which single precision may lose `most_lost` of the spread.
Vec3d world_offset_of(const std::vector<Vec3d>& positions, double most_lost);

/// Where an image's camera stands.   world units
Vec3d center_of(const ColmapImage& image);

/// The model in coordinates from which `offset` is taken off; in double precision.
void take_off(ColmapModel& model, const Vec3d& offset);

/// Whether most positions are nearer to the offset than to 0, so that it was not taken off them; never where it is 0.
bool are_nearer_to(const Vec3d& offset, const std::vector<Vec3d>& positions);

/// A loaded scene in the coordinates that have `offset` taken off, instead of its own.
void bring_to_offset(Scene& scene, const Vec3d& offset);

/// "500000 5400000 0", with all digits that a double needs.
std::string text_of_offset(const Vec3d& offset);

/// {"world_offset": [x, y, z]}: add it to the run's coordinates. Whole or not at all; throws Error.
void write_world_offset(const std::filesystem::path& path, const Vec3d& offset);

}  // namespace gs
