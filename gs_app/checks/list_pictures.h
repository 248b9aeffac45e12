// SPDX-License-Identifier: Apache-2.0
// `gemsplat bench --lists`: pictures of how long the lists of one view are.
#pragma once

#include <filesystem>
#include <string>

#include "gs_core/scene.h"
#include "gs_train/backend.h"

namespace gs {

/// Renders a view with each kind of tile bounds, and writes pictures of the number of Gaussians
/// that each tile lists: lists_square.png, lists_box.png, lists_exact.png. A tile is
/// 4 x 4 pixels; all pictures have one scale, from dark for none to white for the longest list of a
/// tile in lists_square.png. Returns a table of sums and longest lists. Files that are there are
/// kept aside.
std::string write_list_pictures(Backend& backend, const GaussiansSpan& gaussians,
                                const Camera& camera, RenderSettings settings,
                                const std::filesystem::path& folder);

}  // namespace gs
