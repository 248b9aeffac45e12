// SPDX-License-Identifier: Apache-2.0
// The merges of a LodTree as one tree of single Gaussians: each inner one stands for its children.
// Viewers replace a Gaussian by its children where it is large in the picture.
#pragma once

#include "gs_model/lod/lod_tree.h"

namespace gs {

/// Gaussian 0 is the root. The children of Gaussian i are child_start[i], ..., child_start[i] +
/// child_count[i] - 1, all behind i; those without children are the model. From level to level the
/// numbers grow, so that a prefix of the rows is a coarse model, in which each inner Gaussian
/// without its children stands for them.
struct SplatTree {
  Gaussians gaussians;
  std::vector<std::uint32_t> child_start, child_count;  // both 0 where there are no children
};

/// Above the coarsest level, Gaussians of all leaves are merged until one is left.
SplatTree splat_tree_of(const LodTree& lod);

}  // namespace gs
