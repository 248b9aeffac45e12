// SPDX-License-Identifier: Apache-2.0
// Levels of detail of a model: a k-d tree over the means, and in each of its leaves levels with
// ever fewer Gaussians, made by merging (decimate.h).
#pragma once

#include "gs_core/gaussians.h"

namespace gs {

struct LodOptions {
  std::size_t leaf_rows = 50'000;   // a cell with more Gaussians is split
  std::size_t ratio = 4;            // a level has 1/ratio of the Gaussians of the one before it
  std::size_t coarsest_rows = 250;  // no level has fewer, unless the model has
};

/// A level of the whole model. Its rows lie leaf after leaf, and in a leaf about along the Morton
/// curve.
struct LodLevel {
  Gaussians gaussians;
  std::vector<std::size_t> leaf_begin;  // (leaves + 1) first row of each leaf, and behind the last
  // (rows) the row of the next level that holds a row of this one; empty for the coarsest level
  std::vector<std::uint32_t> parent;

  std::size_t count(std::size_t leaf) const { return leaf_begin[leaf + 1] - leaf_begin[leaf]; }
};

struct LodTree {
  std::vector<LodLevel> levels;  // the model itself first, the coarsest last
};

/// Builds the tree. A cell is split at the median of the longest axis of its means; equal means are
/// told apart by their rows. Level k of a leaf with n Gaussians is made of level k - 1, and has
/// max(1, ceil(n / ratio^k)) Gaussians. No merge crosses the boundary of a leaf, so that leaves at
/// different levels fit together. With a ratio of 4, all levels together have 1.33 N Gaussians.
///
/// Rows that are never rendered are dropped, and a 3D filter is baked in. The result depends on the
/// arguments alone. Needs three times the memory of the model, and as long as decimate(). Host
/// memory. Throws UsageError for Gaussians in space and time, and where none is left.
LodTree build_lod_tree(Gaussians gaussians, const LodOptions& options = {});

}  // namespace gs
