// SPDX-License-Identifier: Apache-2.0
// Gaussians as a tree of tiles: the leaves hold all of them, each tile above holds fewer that look
// like those of its children.
#pragma once

#include <vector>

#include "gs_core/gaussians.h"

namespace gs {

/// A box along the axes.
struct TileBox {
  Vec3d low{0.0, 0.0, 0.0}, high{0.0, 0.0, 0.0};
};

/// A tile and all below it.
struct Tile {
  Gaussians gaussians;         // at least one
  TileBox box;                 // holds three standard deviations of all of this tile and below
  double geometric_error = 0;  // world units; 0 where there are no children, and never below theirs
  std::vector<Tile> children;  // none, one or two
};

inline constexpr std::size_t kRootGaussians = 1000;  // of the coarsest tile, at most

/// The error with which a tile gives way to its children when its own splats are wider than two
/// pixels, if a viewer refines tiles of more than 16 pixels of error (as CesiumJS does by default):
///
///   16 / 2 * 2 sigma,  where Gaussians with a largest standard deviation below sigma have a tenth of
///                      the sum of opacity * area
///
/// CesiumJS 1.145 drops splats with a standard deviation below 0.65 pixels. Down to there a tile is
/// shown until the one above it, whose Gaussians are 1.4 times as wide, takes over at 1 pixel.
double geometric_error_of(const Gaussians& gaussians);

/// Splits the Gaussians at the median of the longest axis of their means until no tile has more
/// than `most` (at least 2). The tiles above hold the Gaussians of both children merged to half
/// their number (decimate.h), so each level has half of the one below. Above the tile that covers
/// all, more with one child each follow until kRootGaussians are left. Ties go by index: the same
/// Gaussians give the same tree. Host memory; at least one Gaussian, finite, without time and
/// without a 3D filter.
Tile tile_tree(const Gaussians& gaussians, std::size_t most);

}  // namespace gs
