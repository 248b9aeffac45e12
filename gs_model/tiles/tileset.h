// SPDX-License-Identifier: Apache-2.0
// The folder of a 3D Tiles 1.1 tileset: tileset.json and a .glb for each tile, LEVEL/NUMBER.glb
// with the root as 0/0.glb. The tiles' frame is meters east, north and up of the georeference's
// origin; the root's transform leads from there to earth-centered coordinates.
//
//   TilesetRequest request{"out/tiles", georeference};
//   check_tileset(request, force);                 // before the work starts
//   ExportedTileset tileset = export_tileset(model, request);
#pragma once

#include <cstdint>
#include <filesystem>
#include <string>
#include <vector>

#include "gs_core/gaussians.h"
#include "gs_core/geodesy/georeference.h"

namespace gs {

inline constexpr std::size_t kTileGaussiansAtMost = 50'000;  // some 1 MB, as other tilers have it

struct TilesetRequest {
  std::filesystem::path folder;
  Georeference georeference;
  int sh_degree = kMaxShDegree;                       // the tiles have no higher one
  std::size_t most_gaussians = kTileGaussiansAtMost;  // of a tile
  std::vector<std::filesystem::path> needed = {};     // may not be moved aside with the folder
};

struct ExportedTileset {
  std::filesystem::path folder;
  std::size_t gaussians = 0;  // of the leaves: of the model
  std::size_t tiles = 0, levels = 0;
  std::uint64_t bytes = 0;  // of the tiles
};

/// Throws UsageError if the folder is not empty and may not be moved aside (`force`), or is a file;
/// Error where this build lacks zlib. Writes nothing.
void check_tileset(const TilesetRequest& request, bool force);

/// Writes the tileset, tileset.json last; an older folder becomes FOLDER.bak-N. Rows with NaN or
/// infinity are left out, with a warning. Throws Error, also for a model without Gaussians, and
/// UsageError for Gaussians in space and time.
ExportedTileset export_tileset(const GaussianModel& model, const TilesetRequest& request);

/// "out/tiles: 79879 Gaussians in 3 tiles of 2 levels, 2.9 MB, at longitude 15.5000000, latitude
/// 48.2000000"
std::string summary(const ExportedTileset& tileset, const Georeference& georeference);

}  // namespace gs
