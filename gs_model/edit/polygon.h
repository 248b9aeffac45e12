// SPDX-License-Identifier: Apache-2.0
// An area in a plane with straight edges: several rings, also with holes.
#pragma once

#include <utility>
#include <vector>

#include "gs_core/types.h"

namespace gs {

/// The area inside of rings by the even-odd rule: a ring within a ring is a hole. The last vertex
/// of a ring is joined with the first one.
class Polygon {
 public:
  explicit Polygon(std::vector<std::vector<Vec2<double>>> rings) : rings_(std::move(rings)) {}

  /// Whether a half line from the point crosses the edges an odd number of times.
  bool holds(const Vec2<double>& point) const;
  const std::vector<std::vector<Vec2<double>>>& rings() const { return rings_; }

 private:
  std::vector<std::vector<Vec2<double>>> rings_;
};

}  // namespace gs
