// SPDX-License-Identifier: Apache-2.0
// Codebooks and palettes: a few values that stand for many.   k-means, Lloyd 1982
#pragma once

#include <cstdint>
#include <vector>

namespace gs {

/// `size` ascending numbers that represent `values` (not empty, all finite) with a small squared
/// error: Lloyd's algorithm on the sorted values.
std::vector<float> codebook_of(std::vector<float> values, std::size_t size);

/// The index of the entry of an ascending codebook nearest to `value`.
std::size_t nearest_entry(const std::vector<float>& codebook, float value);

/// A few points of a space that stand for many.
struct Palette {
  std::vector<float> centroids;       // (size, dimensions)
  std::vector<std::uint32_t> labels;  // (N), of the centroid that stands for a point
};

/// A palette of `size` entries, at most one for each point, for points (N, dimensions). It has two
/// levels: k-means finds about sqrt(size) clusters, and each gets centroids by its share of the
/// points. A point is then compared with 2 sqrt(size) centroids instead of all. The palette does
/// not depend on the number of threads.
///
/// weights   (N) above 0, of the points in the means and in the shares of the clusters; empty: all 1
Palette palette_of(const std::vector<float>& points, std::size_t dimensions, std::size_t size,
                   const std::vector<float>& weights = {});

}  // namespace gs
