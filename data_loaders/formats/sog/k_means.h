// SPDX-License-Identifier: Apache-2.0
// Codebooks: a few values that stand for many.   k-means, Lloyd 1982
#pragma once

#include <cstdint>
#include <vector>

namespace gs {

/// `size` numbers, ascending, that stand for `values` (not empty, all finite) with a small squared error: Lloyd's algorithm
/// on the sorted values.
std::vector<float> codebook_of(std::vector<float> values, std::size_t size);

/// The index of the entry of an ascending codebook nearest to `value`.
std::size_t nearest_entry(const std::vector<float>& codebook, float value);

/// Points of a space by a few of their kind.
struct Palette {
  std::vector<float> centroids;       // (size, dimensions)
  std::vector<std::uint32_t> labels;  // (N), of the centroid that stands for a point
};

/// A palette of `size` (at most one for each point) for points (N, dimensions). Two levels: about sqrt(size)
/// clusters by k-means, and in each as many centroids as its share of the points; a point is compared with
/// 2 sqrt(size) centroids, not with all. The same points give the same palette, whatever the number of threads.
Palette palette_of(const std::vector<float>& points, std::size_t dimensions, std::size_t size);

}  // namespace gs
