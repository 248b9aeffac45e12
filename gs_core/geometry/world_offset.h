// SPDX-License-Identifier: Apache-2.0
// Things far from the origin (UTM: 500,000 east, 5,400,000 north) are moved near it in double
// precision, because single precision has steps of half a unit there.
#pragma once

#include <filesystem>
#include <string>
#include <vector>

#include "gs_core/types.h"

namespace gs {

/// The offset to take off all coordinates of things around `median`, nine in ten of them within
/// `spread`: 0 unless single precision loses more than `most_lost` of the spread there, else the
/// median rounded to a power of ten no larger than the spread.
Vec3d world_offset_of(const Vec3d& median, double spread, double most_lost);

/// The offset of a cloud of positions.
Vec3d world_offset_of(const std::vector<Vec3d>& positions, double most_lost);

/// Whether most positions are nearer to the offset than to 0, so that it was not taken off yet.
/// False for an offset of 0.
bool are_nearer_to(const Vec3d& offset, const std::vector<Vec3d>& positions);

/// "500000 5400000 0", with all digits that a double needs.
std::string text_of_offset(const Vec3d& offset);

/// The numbers of the first comment "world_offset X Y Z" of a file; 0 without it, or where it is
/// damaged.
Vec3d offset_of_comments(const std::vector<std::string>& comments);

/// Writes {"world_offset": [x, y, z]}; added to the run's coordinates it gives the scene's. The
/// file exists whole or not at all. Throws Error.
void write_world_offset(const std::filesystem::path& path, const Vec3d& offset);

}  // namespace gs
