// SPDX-License-Identifier: Apache-2.0
// Space in parts, divided by planes that divide what earlier planes have left. Every point is in
// exactly one part, whatever the planes are.
#pragma once

#include <array>
#include <cstddef>
#include <vector>

#include "gs_core/math/density/region.h"

namespace gs {

/// What lies on one side of a cut: a part, or another cut.
struct CutSide {
  bool is_cut = false;
  std::size_t index = 0;  // of the part, or in CutTree::cuts
};

/// A plane. Points p with inner(normal, p) < offset are below it, all others above.
struct Cut {
  Vec3d normal{0.0, 0.0, 0.0};  // unit length
  double offset = 0;            // world units
  CutSide below, above;

  bool is_below(const Vec3d& p) const { return inner(normal, p) < offset; }
};

/// A tree of cuts; the first one is its root. Without cuts all of space is part 0.
struct CutTree {
  std::vector<Cut> cuts;

  std::size_t parts() const { return cuts.size() + 1; }
  std::size_t part_of(const Vec3d& p) const;
  /// The planes around a part: of parallel ones on the same side only the innermost. A plane of
  /// which the part is below appears with the opposite normal, so that the bounds hold all points
  /// of the part.
  std::vector<WideHalfSpace> bounds_of(std::size_t part) const;
  /// Whether each cut is reached from the root on one way, and each part, too: what a file may
  /// break.
  bool is_whole() const;
};

/// How far the middle nine tenths of the points reach along an axis; 0 without points.
///                                                                                  world units
double reach_along(const Vec3d& axis, const std::vector<Vec3d>& points);

/// Two axes at right angles to `up` and to each other. The first one is that along which the nearer
/// nine tenths of the points spread most.
std::array<Vec3d, 2> ground_axes(const Vec3d& up, const std::vector<Vec3d>& points);

/// Divides space into `parts` parts with the same number of points, as nearly as possible. Each cut
/// is across that one of `axes` along which the points reach farther. Parts are numbered from below
/// to above. Points with the same coordinate are on one side, so that a part may have none.
CutTree divide(const std::vector<Vec3d>& points, const std::array<Vec3d, 2>& axes,
               std::size_t parts);

}  // namespace gs
