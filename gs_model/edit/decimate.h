// SPDX-License-Identifier: Apache-2.0
// Fewer Gaussians that look like all of them: pairs of near ones are merged, the cheapest first.
#pragma once

#include <functional>
#include <limits>

#include "gs_model/edit/merge_gaussians.h"

namespace gs {

struct DecimateOptions {
  // How many other Gaussians each one may be merged with: its nearest by means.   2 to 16
  int neighbors = 10;
  // (N) how much pictures show of each Gaussian for its mass, up to a factor (importance_of());
  // empty: nothing is known of pictures (importance_by_size())
  std::vector<float> importance = {};
  // Called now and then by the calling thread with the merges done and all merges; may be empty.
  // What it throws leaves decimate(), and the Gaussians are then undefined.
  std::function<void(std::size_t done, std::size_t total)> on_progress = {};
  // Gets (N): the row of the result that holds each row, kNotRendered for dropped ones. May be
  // null.
  std::vector<std::uint32_t>* merged_into = nullptr;
};

/// (N) DecimateOptions::importance, from what all pictures together show of each Gaussian.
///
/// contributions   (N) sums over pictures of the blending weights of its pixels
/// coverages       (N) as coverages_of() has them
std::vector<float> importance_of(const std::vector<float>& contributions,
                                 const std::vector<float>& coverages);

/// (N) The same where no pictures are known: 1 / surface. Training leaves Gaussians that cover
/// about as many pixels each, so a small one was seen from near or in detail. What a merge changes
/// then counts as a share of what it merges. Those without a surface have 0. Gaussians without
/// time.
std::vector<float> importance_by_size(const Gaussians& gaussians);

inline constexpr std::uint32_t kNotRendered = std::numeric_limits<std::uint32_t>::max();

/// The rows that a renderer can draw: all values are finite, and the rotation is not 0.
std::vector<std::uint32_t> rendered_rows(const Gaussians& gaussians);

/// Reduces `gaussians` to `count` rows by merging pairs with matched moments (merge_gaussians.h),
/// and returns how many rows are left: fewer than `count` only if there were fewer.
///
/// Candidates are the edges of a graph of nearest neighbors. Rounds of merges follow each other:
/// in a round every Gaussian proposes its cheapest edge, and the cheapest proposals that share no
/// Gaussian are merged, at most one for 16 Gaussians. After a round the costs of all edges of
/// merged Gaussians are computed again. The graph is made again whenever half of the Gaussians are
/// gone.
///
/// A 3D filter is baked in first (bake_filter.h), and rows that are never rendered are dropped
/// (rendered_rows()). A merged Gaussian takes the place of the first row that
/// it holds, so that the order stays. The result depends on nothing but the arguments, in
/// particular not on the number of threads. Needs some 200 bytes per Gaussian beside the model,
/// all cores, and half a minute on two of them for a million Gaussians. Host memory. Throws
/// UsageError for Gaussians in space and time.
std::size_t decimate(Gaussians& gaussians, std::size_t count, const DecimateOptions& options = {});

}  // namespace gs
