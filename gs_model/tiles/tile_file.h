// SPDX-License-Identifier: Apache-2.0
// The .glb of one tile, as CesiumJS reads Gaussians in 3D Tiles: an .spz of version 3 inside, under
// the extension KHR_gaussian_splatting_compression_spz_2 (a draft; glTF pull request 2531).
//
// CesiumJS 1.145 takes the numbers of the .spz as they are, without a turn of axes, and takes
// glTF's y up to 3D Tiles' z up: (x, y, z) -> (x, -z, y). The matrix of the node undoes that, so
// that the numbers are coordinates of the tile. SH is evaluated in the same frame.
#pragma once

#include <filesystem>

#include "gs_core/gaussians.h"

namespace gs {

// Extensions that a tile requires, which a tileset must list, too.
inline constexpr const char* kTileGaussians = "KHR_gaussian_splatting";
inline constexpr const char* kTileSpz = "KHR_gaussian_splatting_compression_spz_2";

/// Writes Gaussians that stand in the tile's frame (east, north, up in a tileset on earth). The
/// model is one that finite_model() made, with at least one Gaussian and positions within kSpzReach
/// (spz.h). Throws Error where the file cannot be written. Returns the bytes of the file.
std::uint64_t write_tile(const std::filesystem::path& path, const GaussianModel& model);

}  // namespace gs
