// SPDX-License-Identifier: Apache-2.0
// density.region: a part of space as a user writes it, "x,y,z,d; x,y,z,d; ...".
#pragma once

#include <optional>
#include <string>
#include <string_view>
#include <vector>

#include "gs_core/config/config.h"
#include "gs_core/math/density/region.h"

namespace gs {

/// The half-spaces of a text, in the coordinates of the photos' poses; an empty list for an empty
/// text. nullopt for a text that cannot be read: a word that is no finite number, other than four
/// numbers, a normal of length 0, or too many half-spaces.
std::optional<std::vector<WideHalfSpace>> parse_region(std::string_view text);

/// The text of half-spaces, which parse_region() reads back with the same bits.
std::string text_of_region(const std::vector<WideHalfSpace>& half_spaces);

/// The half-spaces in the coordinates of a scene, from which `world_offset` is subtracted. There
/// are at most Region::kMost of them.
Region region_in_scene(const std::vector<WideHalfSpace>& half_spaces, const Vec3d& world_offset);

/// density.region in the coordinates of a scene. Throws UsageError for a text that is none.
Region region_of(const DensityConfig& density, const Vec3d& world_offset);

}  // namespace gs
