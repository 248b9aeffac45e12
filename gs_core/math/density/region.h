// SPDX-License-Identifier: Apache-2.0
// A convex part of space: what lies inside of a few half-spaces.
#pragma once

#include "gs_core/types.h"

namespace gs {

/// The points p with inner(normal, p) >= offset.
struct HalfSpace {
  Vec3f normal{0.0f};
  double offset = 0;  // world units, for a normal of unit length

  /// Products of floats are exact in double, so that the CPU and the GPU agree about every point.
  GS_HD bool holds(const Vec3f& p) const {
    return double(normal.x) * double(p.x) + double(normal.y) * double(p.y) +
               double(normal.z) * double(p.z) >=
           offset;
  }
};

/// A half-space in double, for places far from the origin.
struct WideHalfSpace {
  Vec3d normal{0.0, 0.0, 0.0};
  double offset = 0;

  bool holds(const Vec3d& p) const { return inner(normal, p) >= offset; }
};

/// The points inside of all half-spaces; without any, all of space.
struct Region {
  static constexpr int kMost = 6;  // a box has six
  HalfSpace half_spaces[kMost];
  int count = 0;

  /// False for a point that is not a number, unless the region is all of space.
  GS_HD bool holds(const Vec3f& p) const {
    for (int i = 0; i < count; ++i)
      if (!half_spaces[i].holds(p)) return false;
    return true;
  }
};

}  // namespace gs
