// SPDX-License-Identifier: Apache-2.0
// How far away a photo's sparse points lie, place by place in its picture.
#pragma once

#include <vector>

#include "gs_core/camera.h"
#include "gs_core/scene.h"

namespace gs {

/// How a photo shows a place: it looks through it to points far behind, it is a witness that
/// something may be there, or it says nothing.
enum class Sight { unknown, through, witness };

/// The depths of the sparse points in the picture of one camera, in cells of a 24th of its longer
/// edge. A cell is known if it and the eight around it show five points or more; the nearest and
/// the farthest tenth of these may be wrong, and do not count.
class PointDepths {
 public:
  PointDepths() = default;
  PointDepths(const Camera& camera, const std::vector<ScenePoint>& points);
  /// `clearance`: share of the depth of the nearest points around the place, 0 to 1; the photo looks
  /// through what is nearer. Places out of the picture and behind the farthest points are unknown.
  Sight sight_of(const Vec3f& place, float clearance) const;

 private:
  struct Range {
    float near = 0, far = 0;  // 0: unknown
  };
  std::size_t cell_of(const Vec2f& pixel) const;
  Camera camera_;
  float cell_ = 1;  // edge, pixels
  int columns_ = 0, rows_ = 0;
  std::vector<Range> ranges_;  // (rows, columns)
};

}  // namespace gs
