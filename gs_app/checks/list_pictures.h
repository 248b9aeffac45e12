// SPDX-License-Identifier: Apache-2.0
// `gemsplat bench --lists`: pictures of how long the lists of one view are.
#pragma once

#include <map>
#include <string>

#include "gs_core/image.h"
#include "gs_core/scene.h"
#include "gs_train/backend.h"

namespace gs {

/// Pictures by file name, and a table of sums and longest lists.
struct ListPictures {
  std::map<std::string, Image8> files;
  std::string table;
};

/// Renders a view with each kind of tile bounds, and draws the number of Gaussians that each tile
/// lists: lists_square.png, lists_box.png, lists_exact.png. A tile is 4 x 4 pixels; all pictures
/// have one scale, from dark for none to white for the longest list of a tile in lists_square.png.
ListPictures list_pictures(Backend& backend, const GaussiansSpan& gaussians, const Camera& camera,
                           RenderSettings settings);

}  // namespace gs
