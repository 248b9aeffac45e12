// SPDX-License-Identifier: Apache-2.0
// Nearest neighbors among points in space.
#pragma once

#include <vector>

#include "gs_core/buffer.h"

namespace gs {

/// A balanced k-d tree (Bentley 1975) over finite points. The caller owns the points, which must
/// stay in place while the tree lives.
class KdTree {
 public:
  explicit KdTree(Span<const Vec3f> points);

  /// Mean squared distance from point `i` to its `k` nearest other points, or to all of them if
  /// there are fewer;
  /// 0 if there are none.   world units^2, 1 <= k <= kMostNearest
  float mean_squared_distance(std::size_t i, int k) const;

  /// Writes the indices of the `k` nearest other points to `to`, the nearest first, and returns how
  /// many there are: fewer than `k` where there are fewer points. 1 <= k <= kMostNearest
  int nearest(std::size_t i, int k, std::uint32_t* to) const;
  static constexpr int kMostNearest = 16;

 private:
  struct Nearest;
  void build(std::size_t begin, std::size_t end, int axis);
  void search(std::size_t begin, std::size_t end, int axis, Nearest& nearest) const;

  Span<const Vec3f> points_;
  std::vector<std::uint32_t> order_;  // each range's median splits it
};

}  // namespace gs
